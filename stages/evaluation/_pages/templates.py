"""The text of the pages. It stands in code, so that an edit of it is an edit of the stages that use it."""

STYLE = """
:root {
  color-scheme: light dark;
  --ground: #fff; --ink: #1c1e21; --soft: #62666d; --line: #d9dbdf; --panel: #f4f5f6; --accent: #0067b0;
  --font: system-ui, "Segoe UI", "Helvetica Neue", Arial, sans-serif;
}
@media screen and (prefers-color-scheme: dark) {
  :root { --ground: #17181b; --ink: #e4e5e8; --soft: #9a9ea6; --line: #35373d; --panel: #202226; --accent: #6cb6f5; }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink); font: 14px/1.45 var(--font); }
main { max-width: 1560px; margin: 0 auto; padding: 20px 28px 60px; }
h1 { font-size: 22px; font-weight: 600; margin: 0; }
h2 { font-size: 16px; font-weight: 600; margin: 34px 0 10px; }
h3 { font-size: 14px; font-weight: 600; margin: 18px 0 6px; }
p { margin: 4px 0 10px; max-width: 90ch; }
.soft, figcaption, caption { color: var(--soft); }
caption { text-align: left; padding: 0 0 6px; }
a { color: var(--accent); }
button {
  font: inherit; color: inherit; background: var(--panel); border: 1px solid var(--line); border-radius: 4px;
  padding: 2px 10px; cursor: pointer;
}
button[aria-pressed="true"] { background: var(--accent); border-color: var(--accent); color: var(--ground); }
:focus-visible { outline: 2px solid var(--accent); outline-offset: 1px; }

.tools { display: flex; flex-wrap: wrap; gap: 6px; align-items: center; margin: 0 0 10px; }
.tools label, .tools .soft { margin-left: 12px; }
.views { display: grid; grid-template-columns: repeat(auto-fit, minmax(320px, 1fr)); gap: 16px; }
figure { margin: 0; min-width: 0; }
figcaption { padding: 5px 0 0; }
figcaption b { color: var(--ink); font-weight: 600; }
.view {
  max-height: 80vh; width: 100%; overflow: auto; background: var(--panel); border: 1px solid var(--line); cursor: zoom-in;
  touch-action: pan-x pan-y;
}
.maps .view { max-height: 420px; }
.view.held { cursor: grabbing; }
.sheet { position: relative; width: 100%; margin: auto; }
.sheet img { display: block; width: 100%; height: 100%; user-select: none; -webkit-user-drag: none; }
.sheet.large img { image-rendering: pixelated; }
.sheet svg { position: absolute; inset: 0; width: 100%; height: 100%; overflow: hidden; pointer-events: none; }
.lattice path { fill: none; vector-effect: non-scaling-stroke; }
.lattice .under { stroke: #000; stroke-width: 3; stroke-opacity: 0.55; }
.lattice .over { stroke: #fff; stroke-width: 1.2; }
.without-lattice .lattice { display: none; }
.legend { display: inline-flex; gap: 6px; align-items: center; }
.legend i { display: inline-block; width: 90px; height: 9px; border: 1px solid var(--line); }

table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: 4px 14px 4px 0; border-bottom: 1px solid var(--line); }
th { font-weight: 600; }
thead th { color: var(--soft); font-weight: 500; vertical-align: bottom; }
tr.axis th, tr.axis td { padding-top: 14px; }
.measures details { display: inline-block; margin: 0 0 0 6px; vertical-align: top; }
td.figure, th.figure { text-align: right; white-space: nowrap; }
.scroll { overflow-x: auto; }
.score { display: inline-flex; gap: 8px; align-items: center; white-space: nowrap; }
.track { display: inline-block; width: 70px; height: 9px; background: var(--panel); border: 1px solid var(--line); }
.track i { display: block; height: 100%; }
.score b { font-weight: 600; min-width: 2.4em; }
.scores { display: flex; flex-wrap: wrap; gap: 2px 18px; margin: 12px 0 0; padding: 0; list-style: none; }
.plot svg { width: 100%; max-width: 960px; height: auto; font-family: var(--font); }
details { margin: 6px 0; }
summary { cursor: pointer; }
code { font: 12px/1.4 ui-monospace, Consolas, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere; }
.params { display: block; max-width: 70ch; white-space: normal; }
.provenance td { white-space: nowrap; }

.grid td, .grid th { padding: 8px 12px 8px 0; }
.grid th { overflow-wrap: anywhere; font-size: 13px; }
.grid tbody th { min-width: 14ch; }
.grid td > .soft { font-size: 12px; }
.grid .soft { font-weight: 400; }
.grid thead th { position: sticky; top: 0; background: var(--ground); color: var(--ink); z-index: 1; }
.thumb { display: block; padding: 0; border: 1px solid var(--line); background: var(--panel); border-radius: 0; line-height: 0; }
.thumb { cursor: zoom-in; }
.thumb img {
  --side: clamp(96px, calc((min(100vw, 1560px) - 250px) / var(--columns) - 14px), 256px);
  width: var(--side); height: var(--side); object-fit: contain;
}
.small { display: grid; grid-template-columns: auto auto; gap: 0 8px; justify-content: start; font-size: 12px; margin: 4px 0 0; }
.small .track { width: 46px; height: 7px; }
/* what is out of sight is not laid out: pages of many items open at once */
.item { content-visibility: auto; contain-intrinsic-size: auto 260px; border-top: 1px solid var(--line); padding: 2px 0 8px; }
.cells { display: flex; flex-wrap: wrap; gap: 12px; align-items: flex-end; }
.cells .thumb img { width: auto; height: auto; max-width: 220px; max-height: 150px; }
.cells figcaption { font-size: 12px; max-width: 220px; }
.item > p { max-width: none; font-size: 12px; }
.curve svg { display: block; width: 170px; height: 100px; }
.missing { color: var(--soft); font-style: italic; }
.best b { text-decoration: underline; text-underline-offset: 3px; }
.kept { color: #1a7f37; }
.lost { color: #c62828; }
.verdicts td { text-align: center; padding: 4px 14px; }
.verdicts th:not(:first-child) { text-align: center; padding: 4px 14px; }
.judged .small { gap: 0 6px; }
.judged .small .track { display: none; }
.is-kept .thumb { border: 2px solid #1a7f37; }
.is-lost .thumb { border: 2px solid #c62828; }
.sure { font-weight: 700; }
.win { white-space: nowrap; }
.win small { color: var(--soft); font-weight: 400; }
dialog { border: 1px solid var(--line); background: var(--ground); color: var(--ink); padding: 10px; max-width: 98vw; max-height: 98vh; }
dialog::backdrop { background: rgb(0 0 0 / 0.7); }
dialog .room { overflow: auto; max-width: 94vw; max-height: 84vh; }
dialog img { display: block; image-rendering: pixelated; }

@media print {
  body { font-size: 10px; }
  main { padding: 0; max-width: none; }
  .tools, dialog { display: none; }
  .views { grid-template-columns: repeat(2, 1fr); }
  .view, .maps .view { max-height: none; overflow: visible !important; border: 0; }
  .sheet { width: 100% !important; height: auto !important; }
  figure, tr, .plot { break-inside: avoid; }
  .track, .track i, .legend i { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  .thumb img { width: 120px; height: 120px; }
}
"""

SCRIPT = """
"use strict";
// Pictures of one group share their scale; at 100 % a pixel of a picture is a pixel of the screen.
for (const group of document.querySelectorAll("[data-zoom]")) {
  const views = [...group.querySelectorAll(".view")];
  const buttons = [...group.querySelectorAll("button[data-scale]")];
  const together = group.hasAttribute("data-together");
  let mode = "fit";
  const room = (view) => Math.min(view.clientWidth / view.dataset.width, view.clientHeight / view.dataset.height);
  const show = (next, clicked, place) => {
    const middles = views.map((view) => [
      (view.scrollLeft + view.clientWidth / 2) / view.scrollWidth,
      (view.scrollTop + view.clientHeight / 2) / view.scrollHeight,
    ]);
    mode = next;
    for (const view of views) view.style.overflow = mode === "fit" ? "hidden" : "auto";
    const scale = mode === "fit" ? Math.min(...views.map(room)) : mode / devicePixelRatio;
    views.forEach((view, index) => {
      const sheet = view.firstElementChild;
      sheet.style.width = view.dataset.width * scale + "px";
      sheet.style.height = view.dataset.height * scale + "px";
      sheet.classList.toggle("large", scale * devicePixelRatio > 1);
      const [x, y] = view === clicked || (clicked && together) ? place : middles[index];
      view.scrollLeft = x * view.scrollWidth - view.clientWidth / 2;
      view.scrollTop = y * view.scrollHeight - view.clientHeight / 2;
    });
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.scale === String(mode)));
    group.dataset.zoom = String(mode);
  };
  for (const button of buttons) {
    button.addEventListener("click", () => show(button.dataset.scale === "fit" ? "fit" : Number(button.dataset.scale)));
  }
  for (const view of views) {
    let from = null;
    view.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || event.pointerType === "touch") return;
      from = { x: event.clientX, y: event.clientY, left: view.scrollLeft, top: view.scrollTop, moved: false };
    });
    view.addEventListener("pointermove", (event) => {
      if (!from) return;
      const x = event.clientX - from.x;
      const y = event.clientY - from.y;
      if (!from.moved && Math.hypot(x, y) < 4) return;
      from.moved = true;
      view.setPointerCapture(event.pointerId);
      view.classList.add("held");
      view.scrollLeft = from.left - x;
      view.scrollTop = from.top - y;
    });
    let dragged = false;
    const release = () => {
      dragged = from !== null && from.moved;
      view.classList.remove("held");
      from = null;
    };
    view.addEventListener("pointerup", release);
    view.addEventListener("pointercancel", release);
    view.addEventListener("click", (event) => {
      if (dragged) return;
      const box = view.firstElementChild.getBoundingClientRect();
      const place = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
      show({ fit: 1, 1: 2 }[mode] ?? "fit", view, place);
    });
    view.addEventListener("scroll", () => {
      if (!together) return;
      for (const other of views) {
        if (other.scrollLeft !== view.scrollLeft) other.scrollLeft = view.scrollLeft;
        if (other.scrollTop !== view.scrollTop) other.scrollTop = view.scrollTop;
      }
    });
  }
  for (const box of group.querySelectorAll("input[data-lattice]")) {
    box.addEventListener("change", () => group.classList.toggle("without-lattice", !box.checked));
  }
  addEventListener("resize", () => show(mode));
  show("fit");
}

// Thumbnails open at full size; the arrow keys go along the row and from row to row.
const dialog = document.querySelector("dialog");
if (dialog) {
  const thumbs = [...document.querySelectorAll(".thumb")];
  const picture = dialog.querySelector("img");
  let current = 0;
  const open = (index) => {
    current = (index + thumbs.length) % thumbs.length;
    const source = thumbs[current].querySelector("img");
    picture.src = source.src;
    picture.alt = source.alt;
    picture.style.width = source.naturalWidth / devicePixelRatio + "px";
    dialog.querySelector("[data-name]").textContent = source.alt;
    if (!dialog.open) dialog.showModal();
  };
  thumbs.forEach((thumb, index) => thumb.addEventListener("click", () => open(index)));
  const along = (way) => {
    const column = thumbs[current].dataset.column;
    let index = current;
    do index = (index + way + thumbs.length) % thumbs.length; while (thumbs[index].dataset.column !== column);
    open(index);
  };
  dialog.addEventListener("keydown", (event) => {
    const move = {
      ArrowLeft: () => open(current - 1), ArrowRight: () => open(current + 1),
      ArrowUp: () => along(-1), ArrowDown: () => along(1),
    }[event.key];
    if (move) { event.preventDefault(); move(); }
  });
  dialog.addEventListener("click", (event) => { if (event.target === dialog) dialog.close(); });
  dialog.querySelector("[data-close]").addEventListener("click", () => dialog.close());
}
"""

_BASE = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy"
  content="default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{{ digest }}'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title>
<link rel="icon" href="data:,">
<style>{{ style }}</style>
</head>
<body>
<main>
{% block main %}{% endblock %}
</main>
<script>{{ script }}</script>
</body>
</html>
"""

_PARTS = """\
{% macro score(value) %}
<span class="score"><span class="track"><i style="width: {{ (100 * (value or 0)) | round(1) }}%; background: {{ value | score_color }}"></i></span><b>{{ "–" if value is none else "%.2f" | format(value) }}</b></span>
{%- endmacro %}

{% macro tools() %}
<button type="button" data-scale="fit" aria-pressed="true">Fit</button>
<button type="button" data-scale="1" aria-pressed="false">100 %</button>
<button type="button" data-scale="2" aria-pressed="false">200 %</button>
<button type="button" data-scale="4" aria-pressed="false">400 %</button>
{% endmacro %}

{% macro view(shown, name, room, caller=none) %}
<div class="view" style="aspect-ratio: {{ room.width }} / {{ room.height }}" tabindex="0" aria-label="{{ name }}" data-width="{{ shown.width }}" data-height="{{ shown.height }}">
<div class="sheet"><img src="{{ shown.source }}" width="{{ shown.width }}" height="{{ shown.height }}" alt="{{ name }}" draggable="false">
{{- caller() if caller }}</div></div>
{% endmacro %}

{% macro size(shown) %}
{{ shown.height }}×{{ shown.width }} px{% if shown.is_reduced %}, shown from {{ shown.held[0] }}×{{ shown.held[1] }} px{% endif %}
{% endmacro %}

{% macro thumb(shown, name, column) %}
<button type="button" class="thumb" data-column="{{ column }}"><img src="{{ shown.source }}" alt="{{ name }}" width="{{ shown.held[1] }}" height="{{ shown.held[0] }}" loading="lazy" decoding="async"></button>
{% endmacro %}

{% macro provenance(steps) %}
{% if steps %}
<h2>How it was made</h2>
<div class="scroll"><table class="provenance">
<thead><tr><th>Step</th><th>Stage</th><th>Parameters</th><th>Seed</th><th class="figure">Time</th><th>Made by, UTC</th><th>Key</th></tr></thead>
<tbody>
{% for step in steps %}
{% set first = step.runs[0] %}
<tr><th scope="row">{{ step.step }}</th><td>{{ step.stage }}<br><span class="soft">version {{ step.version }}</span></td>
<td><code class="params">{% for name, value in step.params.items() %}{{ name }}: {{ value }}{% if not loop.last %}; {% endif %}{% endfor %}</code></td>
{% if step.runs | length == 1 %}
<td>{{ first.seed or "" }}</td><td class="figure">{{ step.seconds | seconds }}</td>
<td>{{ step.program }}<br><span class="soft">{{ (first.created or "") | string | truncate(19, True, "") | replace("T", " ") }}</span></td>
<td>{% if first.item %}{{ first.item }}<br>{% endif %}<code title="{{ first.key }}">{{ (first.key or "") | string | truncate(12, True, "") }}</code></td></tr>
{% else %}
<td></td><td class="figure">{{ step.seconds | seconds }}</td><td>{{ step.program }}</td>
<td><details><summary>{{ step.runs | length }} runs</summary>
{% for run in step.runs %}
<div>{{ run.item or "" }}{% if run.seed %} <span class="soft">seed {{ run.seed }}</span>{% endif %} {{ run.seconds | seconds }} <code title="{{ run.key }}">{{ (run.key or "") | string | truncate(12, True, "") }}</code> <span class="soft">{{ (run.created or "") | string | truncate(19, True, "") | replace("T", " ") }}</span></div>
{% endfor %}
</details></td></tr>
{% endif %}
{% endfor %}
</tbody></table></div>
{% endif %}
{% endmacro %}
"""

_REPORT = """\
{% extends "base.html" %}
{% import "parts.html" as parts %}
{% block main %}
<header>
<h1>{{ title }}</h1>
<ul class="scores">
{% for _, groups in tables %}{% for group in groups %}
<li>{{ group.axis }} {{ parts.score(group.score) }}</li>
{% endfor %}{% endfor %}
</ul>
</header>

<section data-zoom="fit" id="pictures">
<h2>Exemplar and result</h2>
<div class="tools">
{{ parts.tools() }}
{% if lattice %}<label><input type="checkbox" data-lattice checked> lattice</label>{% endif %}
<span class="soft">Click zooms, drag or scroll moves; both have the same scale.</span>
</div>
<div class="views">
<figure>
{% call parts.view(exemplar, "exemplar", image) %}
{% if lattice %}
<svg class="lattice" viewBox="0 0 {{ exemplar.width }} {{ exemplar.height }}" preserveAspectRatio="none" aria-hidden="true"><path class="under" d="{{ lattice }}"/><path class="over" d="{{ lattice }}"/></svg>
{% endif %}
{% endcall %}
<figcaption><b>Exemplar</b>, {{ parts.size(exemplar) }}
{%- if lattice %}; lattice of {% for row, column in generators %}({{ "%.1f" | format(row) }}, {{ "%.1f" | format(column) }}){{ " and " if not loop.last }}{% endfor %} px down and right, drawn through the middle
{%- elif generators is not none %}; no lattice{% endif %}</figcaption>
</figure>
<figure>
{{ parts.view(image, "result", image) }}
<figcaption><b>Result</b>, {{ parts.size(image) }}</figcaption>
</figure>
</div>
</section>

{% for pair in channels %}
<section data-zoom="fit" id="map-{{ pair.name }}">
<h2>{{ pair.title }}</h2>
<div class="tools">{{ parts.tools() }} <span class="soft">{{ pair.what }}</span></div>
<div class="views">
{% if pair.exemplar %}
<figure>
{{ parts.view(pair.exemplar, "exemplar's " ~ pair.name, image) }}
<figcaption><b>Exemplar</b></figcaption>
</figure>
{% endif %}
<figure>
{{ parts.view(pair.image, "result's " ~ pair.name, image) }}
<figcaption><b>Result</b></figcaption>
</figure>
</div>
</section>
{% endfor %}

{% if preview %}
<section data-zoom="fit" id="lit">
<h2>Under a light that goes around</h2>
<div class="tools">{{ parts.tools() }} <span class="soft">Above the exemplar, below the result, where both are there.</span></div>
{{ parts.view(preview, "lit preview", preview) }}
</section>
{% endif %}

{% if maps %}
<section data-zoom="fit" data-together class="maps" id="maps">
<h2>What was read from the exemplar, and how it was used</h2>
<div class="tools">{{ parts.tools() }}</div>
<div class="views">
{% for map in maps %}
<figure>
{{ parts.view(map.shown, map.name, map.shown) }}
<figcaption><b>{{ map.name }}</b>. {{ map.what }}
{% if map.ends %}
<span class="legend">{{ map.ends[0] | number }} <i style="background: linear-gradient(to right, {{ legend | join(', ') }})"></i> {{ map.ends[2] | number }}</span>
{% endif %}
</figcaption>
</figure>
{% endfor %}
</div>
</section>
{% endif %}

{% if energies %}
<section>
<h2>Energy at every scale</h2>
<div class="plot">{{ energies | safe }}</div>
</section>
{% endif %}

{% for name, groups in tables %}
<section>
<h2>{{ name }}</h2>
<div class="scroll"><table class="measures">
<caption>Score 1 is as good as the exemplar's own parts are, 0 as bad as a bad result.</caption>
<thead><tr><th>Measure</th><th>Score</th><th class="figure">Value</th><th class="figure">Good</th><th class="figure">Bad</th><th>What it is</th></tr></thead>
<tbody>
{% for group in groups %}
<tr class="axis"><th>{{ group.axis }}</th><td>{{ parts.score(group.score) }}</td><td colspan="4"></td></tr>
{% for line in group.lines %}
<tr><td>{{ line.name }}</td><td>{{ parts.score(line.score) }}</td><td class="figure">{{ line.value | number }}</td><td class="figure">{{ line.floor | number }}</td><td class="figure">{{ line.ceiling | number }}</td>
<td>{{ line.what or "" }}{% if line.reason %} <span class="soft">Not scored: {{ line.reason }}.</span>{% endif %}
{% if line.more %}<details><summary class="soft">parts</summary>
{% for part, value in line.more.items() %}
<div>{{ part }}: {% if value is mapping %}{% for key, inner in value.items() %}{{ key }} {{ inner | number }}{{ ", " if not loop.last }}{% endfor %}{% else %}{{ value | number }}{% endif %}</div>
{% endfor %}
</details>{% endif %}</td></tr>
{% endfor %}
{% endfor %}
</tbody></table></div>
</section>
{% endfor %}

{{ parts.provenance(steps) }}
{% endblock %}
"""

_COMPARISON = """\
{% extends "base.html" %}
{% import "parts.html" as parts %}

{% macro wins(methods, standing) %}
<div class="scroll"><table class="wins">
<thead><tr><th>wins – losses – ties</th>{% for other in methods %}<th>against {{ other }}</th>{% endfor %}<th>win rate</th></tr></thead>
<tbody>
{% for one in methods %}
<tr><th scope="row">{{ one }}</th>
{% for other in methods %}
{% set pair = standing.wins.get(one, {}).get(other) %}
<td class="win">{% if pair %}
{% set p = pair.holm if pair.holm is not none else pair.p %}
<span{% if p is not none and p < 0.05 %} class="sure"{% endif %}>{{ pair.wins | number }} – {{ pair.losses | number }} – {{ pair.ties | number }}</span>
<br><small{% if pair.reason %} title="{{ pair.reason }}"{% endif %}>{% if p is none %}not tested{% else %}p = {{ p | number }}{% endif %}</small>
{% endif %}</td>
{% endfor %}
<td>{{ parts.score(standing.rates.get(one)) }}</td></tr>
{% endfor %}
</tbody></table></div>
{% endmacro %}

{% macro means(methods, standing) %}
{% for method in methods %}
<td{% if method in standing.best and standing.best | length < methods | length %} class="best"{% endif %}>{{ parts.score(standing.means[method]) }}</td>
{% endfor %}
<td class="figure">{{ standing.exemplars | number }}</td>
{% endmacro %}

{% block main %}
<header>
<h1>{{ title }}</h1>
<p class="soft">{{ methods | length }} methods, {{ count }} results each
{%- for method, number in failed.items() %}; {{ number }} of {{ method }} failed{% endfor %}.
Score 1 is as good as the exemplar's own parts are, 0 as bad as a bad result.</p>
</header>

{% if overall.wins %}
<section>
<h2>Who wins</h2>
<p class="soft">By exemplar, all axes together. Each row is read from the view of its method. p is the chance of so
clear a difference between equals, corrected for the number of pairs; below 0.05 the figures are bold.</p>
{{ wins(methods, overall) }}
</section>
{% endif %}

{% if groups %}
<section>
<h2>Mean scores</h2>
<div class="scroll"><table class="means">
<caption>Over the exemplars on which all methods have a score. The best of a line are underlined.</caption>
<thead><tr><th>Measure</th>{% for method in methods %}<th>{{ method }}</th>{% endfor %}<th class="figure">Exemplars</th><th>What it is</th></tr></thead>
<tbody>
<tr class="axis"><th scope="row">overall</th>{{ means(methods, overall) }}<td></td></tr>
{% for group in groups %}
<tr class="axis"><th scope="row">{{ group.axis }}</th>{{ means(methods, group) }}<td></td></tr>
{% for line in group.lines %}
<tr><td>{{ line.name }}</td>{{ means(methods, line) }}<td class="soft">{{ line.what }}</td></tr>
{% endfor %}
{% endfor %}
</tbody></table></div>
<details><summary>Wins by axis and measure</summary>
{% for group in groups %}
{% if group.wins %}<h3>{{ group.axis }}</h3>
{{ wins(methods, group) }}{% endif %}
{% for line in group.lines %}{% if line.wins %}
<h3>{{ line.name }}</h3>
{{ wins(methods, line) }}
{% endif %}{% endfor %}
{% endfor %}
</details>
</section>
{% endif %}

{% if plot %}
<section>
<h2>Scores by axis</h2>
<p class="soft">Dots are means; every thin line is one item that all methods have done.</p>
<div class="plot">{{ plot | safe }}</div>
</section>
{% endif %}

<section>
<h2>Pictures</h2>
<p class="soft">Click opens a picture; then the arrow keys go to its neighbours.</p>
<table class="grid" style="--columns: {{ methods | length + 1 }}">
<thead><tr><th>Item</th><th>Exemplar</th>{% for method in methods %}<th>{{ method }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in rows %}
<tr><th scope="row">{{ row.name }}{% if row.seed is not none %}<br><span class="soft">seed {{ row.seed }}</span>{% endif %}
{% for source, file in row.sources.items() %}<br><span class="soft">{{ file }}</span>{% endfor %}</th>
{% if row.span %}
<td rowspan="{{ row.span }}">{% if row.exemplar %}{{ parts.thumb(row.exemplar, row.name ~ ", exemplar", 0) }}<span class="soft">{{ parts.size(row.exemplar) }}</span>{% else %}<span class="missing">none</span>{% endif %}</td>
{% endif %}
{% for cell in row.cells %}
<td>{% if cell.shown %}
{{ parts.thumb(cell.shown, row.name ~ (", seed " ~ row.seed if row.seed is not none else "") ~ ", " ~ cell.method, loop.index) }}
<span class="soft">{{ parts.size(cell.shown) }}</span>
{% else %}<span class="missing">failed</span>{% endif %}
{% if cell.scores %}<div class="small">{% for axis, value in cell.scores.items() if value is not none %}<span>{{ axis }}</span>{{ parts.score(value) }}{% endfor %}</div>{% endif %}
</td>
{% endfor %}</tr>
{% endfor %}
</tbody></table>
</section>

{{ parts.provenance(steps) }}

<dialog aria-label="Picture"><div class="tools"><b data-name></b><button type="button" data-close>Close</button></div>
<div class="room"><img alt=""></div></dialog>
{% endblock %}
"""

_INVERSE_REPORT = """\
{% extends "base.html" %}
{% import "parts.html" as parts %}

{% block main %}
<header>
<h1>{{ title }}</h1>
<p class="soft">{{ rows | length }} textures{% if failed %}, {{ failed }} of them failed{% endif %}.
Energies in squared CIELAB units a pixel: how much of the texture a small picture lacks, and how much of it is foreign.
Score 1 would be the texture itself, 0 is its mean colour.</p>
</header>

<section>
<h2>Energies</h2>
<div class="scroll"><table class="means">
<caption>Lower is better; the lowest of a line is underlined. The name leads to the pictures.</caption>
<thead><tr><th>Texture</th><th class="figure">Texture, px</th><th class="figure">Compaction, px</th>{% for method in methods %}<th class="figure" title="{{ meanings[method] }}">{{ method }}</th>{% endfor %}{% for measure in others %}<th class="figure" title="{{ meanings[measure] }}">{{ measure }}</th>{% endfor %}<th class="figure">Time</th></tr></thead>
<tbody>
{% if rows | length > 1 %}
<tr class="axis"><th scope="row">mean</th><td></td><td></td>{% for name in methods + others %}<td class="figure">{{ means[name] | number }}</td>{% endfor %}<td class="figure">{{ seconds | seconds }}</td></tr>
{% if methods | length > 1 %}<tr><th scope="row">lowest of all, times</th><td></td><td></td>{% for name in methods %}<td class="figure">{{ wins[name] }}</td>{% endfor %}{% for _ in others %}<td></td>{% endfor %}<td></td></tr>{% endif %}
{% endif %}
{% for row in rows %}
<tr><td><a href="#item-{{ loop.index }}">{{ row.name }}</a></td>
<td class="figure">{{ row.sizes[0] }}</td><td class="figure">{{ row.sizes[1] }}</td>
{% for name in methods %}{% set line = row.lines.get(name) %}
<td class="figure{% if name == row.best %} best{% endif %}"{% if line and line.more %} title="inverse {{ line.more.inverse | number }}, forward {{ line.more.forward | number }}"{% endif %}>{% if name == row.best %}<b>{% endif %}{{ line.value | number if line else "–" }}{% if name == row.best %}</b>{% endif %}</td>
{% endfor %}
{% for name in others %}<td class="figure">{{ row.lines[name].value | number if name in row.lines else "–" }}</td>{% endfor %}
<td class="figure">{{ row.seconds | seconds }}</td></tr>
{% endfor %}
</tbody></table></div>
</section>

<section>
<h2>Pictures</h2>
<p class="soft">Click opens a picture; then the arrow keys go to its neighbours. Beside the compaction, its energy round by
round: one line a level, coarse ones left.</p>
{% for row in rows %}
<article class="item" id="item-{{ loop.index }}">
<h3>{{ row.name }}{% if row.seed is not none %} <span class="soft">seed {{ row.seed }}</span>{% endif %}
{% for source, file in row.sources.items() %} <span class="soft">{{ source }}: {{ file }}</span>{% endfor %}</h3>
<div class="cells">
{% for cell in row.cells %}
<figure>
{% if cell.shown %}
{{ parts.thumb(cell.shown, row.name ~ ", " ~ cell.label, loop.index) }}
<figcaption><b>{{ cell.label }}</b> {{ cell.shown.height }}×{{ cell.shown.width }} px</figcaption>
{% else %}<span class="missing">{{ cell.label }}: none</span>{% endif %}
</figure>
{% endfor %}
{% if row.curve %}<figure class="curve">{{ row.curve | safe }}<figcaption>{{ row.rounds }} rounds, energy {{ row.last | number }} at the end</figcaption></figure>{% endif %}
</div>
{% if row.steps %}<p class="soft">{% for step, took in row.steps.items() %}{{ step }} {{ took | seconds }}{{ ", " if not loop.last }}{% endfor %}</p>{% endif %}
</article>
{% endfor %}
</section>

{{ parts.provenance(steps) }}

<dialog aria-label="Picture"><div class="tools"><b data-name></b><button type="button" data-close>Close</button></div>
<div class="room"><img alt=""></div></dialog>
{% endblock %}
"""

_VERDICTS = """\
{% extends "base.html" %}
{% import "parts.html" as parts %}

{% macro mark(verdict) %}
{%- if not verdict.made %}<span class="missing">failed</span>
{%- elif verdict.preserved %}<b class="kept" title="preserved">✓</b>
{%- else %}<b class="lost" title="not preserved">×</b>{% endif %}
{%- endmacro %}

{% block main %}
<header>
<h1>{{ title }}</h1>
<p class="soft">{{ methods | length }} methods on {{ rows | length }} exemplars. <b class="kept">✓</b> the result has the exemplar's
lattice, whole (score of recall at least {{ bounds.recall | number }}) and even (its points at most {{ bounds.uneven | number }} times
as unevenly spaced as the exemplar's, or within {{ (100 * bounds.even) | number }} % of a cell). <b class="lost">×</b> it has not.</p>
</header>

{% for kind, part in kinds.items() if part.exemplars %}
<section>
<h2>{{ kind | capitalize }} textures</h2>
<div class="scroll"><table class="verdicts">
<thead><tr><th>Texture</th>{% for method in methods %}<th>{{ method | replace("_", " ") }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in rows if row.kind == kind %}
<tr><th scope="row"><a href="#item-{{ row.number }}">{{ row.name }}</a></th>
{% for method in methods %}<td>{{ mark(row.verdicts[method]) }}</td>{% endfor %}</tr>
{% endfor %}
<tr class="axis"><th scope="row">preserved</th>
{% for method in methods %}
<td>{{ part.methods[method].preserved }} of {{ part.exemplars }}<br>{{ parts.score(part.methods[method].rate) }}</td>
{% endfor %}</tr>
</tbody></table></div>
</section>
{% endfor %}

<section>
<h2>Pictures</h2>
<p class="soft">Click opens a picture; then the arrow keys go to its neighbours. <i>Uneven</i> is how unevenly the points are
spaced, by how unevenly the exemplar's are.</p>
<table class="grid judged" style="--columns: {{ methods | length + 1 }}">
<thead><tr><th>Item</th><th>Exemplar</th>{% for method in methods %}<th>{{ method | replace("_", " ") }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in rows %}
<tr id="item-{{ row.number }}"><th scope="row">{{ row.name }}{% if row.seed is not none %}<br><span class="soft">seed {{ row.seed }}</span>{% endif %}
<br><span class="soft">{{ row.kind or "no lattice found" }}</span></th>
<td>{% if row.exemplar %}{{ parts.thumb(row.exemplar, row.name ~ ", exemplar", 0) }}<span class="soft">{{ parts.size(row.exemplar) }}</span>{% else %}<span class="missing">none</span>{% endif %}</td>
{% for method in methods %}
{% set verdict = row.verdicts[method] %}
<td{% if row.kind and verdict.made %} class="{{ "is-kept" if verdict.preserved else "is-lost" }}"{% endif %}>{% if row.images[method] %}
{{ parts.thumb(row.images[method], row.name ~ ", " ~ method, loop.index) }}
{% else %}<span class="missing">failed</span>{% endif %}
{% if row.kind and verdict.made %}<div class="small"><span>{{ mark(verdict) }}</span><span></span>
{% for name, score in verdict.scores.items() %}<span>{{ name }}</span>{{ parts.score(score) }}{% endfor %}
<span>uneven</span><b>{{ "–" if verdict.uneven is none else "%.2f" | format(verdict.uneven) }}</b></div>{% endif %}
</td>
{% endfor %}</tr>
{% endfor %}
</tbody></table>
</section>

{{ parts.provenance(steps) }}

<dialog aria-label="Picture"><div class="tools"><b data-name></b><button type="button" data-close>Close</button></div>
<div class="room"><img alt=""></div></dialog>
{% endblock %}
"""

_CONTOURS = """\
{% extends "base.html" %}
{% import "parts.html" as parts %}

{% block main %}
<header>
<h1>{{ title }}</h1>
<p class="soft">{{ rows | length }} exemplars, {{ detectors | length }} detectors. Contours: black is none, white the strongest.
Features: white, with their share of the pixels. Guidance: signed distance to the features' borders, from the
inside <span class="legend"><i style="background: linear-gradient(90deg, {{ legend | join(", ") }})"></i></span> to the
outside, with its largest size and its weight. Click opens a picture; then the arrow keys go to its neighbours.</p>
</header>

<table class="grid" style="--columns: {{ 3 * (detectors | length) + 1 }}">
<thead><tr><th>Exemplar</th>{% for detector in detectors %}<th>{{ detector }}: contours</th><th>features</th><th>guidance</th>{% endfor %}</tr></thead>
<tbody>
{% for row in rows %}
<tr><td><b>{{ row.name }}</b><br>
{% if row.exemplar %}{{ parts.thumb(row.exemplar, row.name ~ ", exemplar", 0) }}<span class="soft">{{ parts.size(row.exemplar) }}</span>{% else %}<span class="missing">none</span>{% endif %}</td>
{% for detector, cell in row.cells.items() %}
{% set first = 3 * loop.index0 %}
<td><br>{% if cell.contours %}{{ parts.thumb(cell.contours, row.name ~ ", contours by " ~ detector, first + 1) }}{% else %}<span class="missing">failed</span>{% endif %}</td>
<td><br>{% if cell.features %}{{ parts.thumb(cell.features, row.name ~ ", features by " ~ detector, first + 2) }}<span class="soft">{{ "%.0f" | format(100 * cell.share) }} %</span>{% else %}<span class="missing">failed</span>{% endif %}</td>
<td><br>{% if cell.guidance %}{{ parts.thumb(cell.guidance, row.name ~ ", guidance by " ~ detector, first + 3) }}<span class="soft">{{ cell.reach | number }} px, weight {{ cell.weight | number }}</span>{% else %}<span class="missing">failed</span>{% endif %}</td>
{% endfor %}</tr>
{% endfor %}
</tbody></table>

{{ parts.provenance(steps) }}

<dialog aria-label="Picture"><div class="tools"><b data-name></b><button type="button" data-close>Close</button></div>
<div class="room"><img alt=""></div></dialog>
{% endblock %}
"""

TEMPLATES = {
    "base.html": _BASE,
    "parts.html": _PARTS,
    "report.html": _REPORT,
    "comparison.html": _COMPARISON,
    "inverse_report.html": _INVERSE_REPORT,
    "verdicts.html": _VERDICTS,
    "contours.html": _CONTOURS,
}
