"""Renders GLSL without a window: moderngl with EGL, Mesa's software driver where there is no graphics card."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from texloom.stages.synthesis.endless.noise import Noise

_VERTICES = "#version 330\nin vec2 at; void main() { gl_Position = vec4(at, 0.0, 1.0); }"


def context() -> Any:
    moderngl = pytest.importorskip("moderngl")
    try:
        return moderngl.create_standalone_context(backend="egl")
    except Exception as error:  # it raises plain ones
        pytest.skip(f"no EGL: {error}")


def rendered(source: str, textures: dict[str, Any], side: int) -> np.ndarray:
    """What a fragment shader writes to ``result`` on a square of pixels, (side, side, 4), the first row at y = 0.

    ``textures``: the levels of detail of each sampler, (h, w, 4) float32; a single one is sampled without them.
    """
    import moderngl

    with context() as gl:
        program = gl.program(vertex_shader=_VERTICES, fragment_shader=source)
        kept = []
        for unit, (name, levels) in enumerate(textures.items()):
            height, width = levels[0].shape[:2]
            texture = gl.texture((width, height), 4, levels[0].tobytes(), dtype="f4")
            if len(levels) > 1:
                texture.build_mipmaps(0, len(levels) - 1)
                for level, pixels in enumerate(levels):
                    texture.write(np.ascontiguousarray(pixels).tobytes(), level=level)
                texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
            else:
                texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
                texture.repeat_x = texture.repeat_y = False
            texture.use(unit)
            if name in program:  # else the compiler has left it out
                program[name] = unit
            kept.append(texture)
        corners = gl.buffer(np.array([-1, -1, 3, -1, -1, 3], np.float32).tobytes())
        target = gl.framebuffer([gl.texture((side, side), 4, dtype="f4")])
        target.use()
        gl.vertex_array(program, [(corners, "2f", "at")]).render()
        return np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(side, side, 4)


def textures_of(noise: Noise) -> dict[str, Any]:
    """The samplers of a shader of by-example noise."""
    pages = noise.pyramid[0].shape[2] // 4
    made = {
        f"gaussian_{page + 1}": [level[..., 4 * page : 4 * page + 4] for level in noise.pyramid]
        for page in range(pages)
    }
    return {**made, "inverse_table": [noise.inverse]}


def validated(source: Path, text: str, *options: str) -> None:
    """Fail with what the compiler says, unless it takes the text; skip without it."""
    validator = shutil.which("glslangValidator")
    if validator is None:
        pytest.skip("no glslangValidator")
    source.write_text(text)
    run = subprocess.run(
        [validator, *options, source.name], cwd=source.parent, check=False, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stdout


def as_glsl(folder: Path, hlsl: str) -> str:
    """A fragment shader, whose function is ``main``, translated by way of SPIR-V; skip where it only compiles."""
    validated(folder / "a.hlsl", hlsl, *["-D", "-e", "main", "-S", "frag", "-V", "-o", "a.spv"])
    assert (folder / "a.spv").stat().st_size > 1000
    translator = shutil.which("spirv-cross")
    if translator is None:
        pytest.skip("no spirv-cross; it compiles")
    command = [translator, "a.spv", "--version", "330", "--no-es", "--output", "a.glsl"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return (folder / "a.glsl").read_text()


def sampled_by(glsl: str, textures: dict[str, Any]) -> dict[str, Any]:
    """The textures of a translated shader by its names for them, without those that it has left out."""
    samplers = re.findall(r"uniform sampler2D (\w+);", glsl)
    found = {name: levels for own, levels in textures.items() for name in samplers if own in name}
    assert len(found) == len(samplers)
    return found


def compiles_osl(folder: Path, name: str, text: str) -> None:
    """By oslc, or by Blender's module where `TEXLOOM_BLENDER` names a Python that has it; else skip."""
    blender = os.environ.get("TEXLOOM_BLENDER")
    if shutil.which("oslc"):
        command = ["oslc", f"{name}.osl"]
    elif blender:
        program = f"import bpy, _cycles, sys; sys.exit(not _cycles.osl_compile('{name}.osl', '{name}.oso'))"
        command = [blender, "-c", program]
    else:
        pytest.skip("no oslc, and TEXLOOM_BLENDER names no Python with bpy")
    (folder / f"{name}.osl").write_text(text)
    run = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    assert (folder / f"{name}.oso").stat().st_size > 1000
