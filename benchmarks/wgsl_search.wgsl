// One phase of `texloom.stages.kernels.patchmatch.search.sweep`, bit-identical to it.
//
// A workgroup has a strip; ROWS of its patches are visited at a time, each one column behind that of the row before
// it. So a patch sees those before it as they have become and those after it as they were, as in a scan on a CPU.
// LANES invocations share the distance of a patch; whatever else is decided of it, all of them decide alike.

@group(0) @binding(0) var<storage, read> scan: array<i64>;  // the order is that of `_numbers`
@group(0) @binding(1) var<storage, read> features: array<i32>;
@group(0) @binding(2) var<storage, read> exemplar: array<i32>;
@group(0) @binding(3) var<storage, read> penalty: array<i64>;
@group(0) @binding(4) var<storage, read> unused_place: array<vec2<i32>>;
@group(0) @binding(5) var<storage, read> strips: array<vec2<i32>>;
@group(0) @binding(6) var<storage, read_write> matches: array<vec2<i32>>;
@group(0) @binding(7) var<storage, read_write> distances: array<i64>;
@group(0) @binding(8) var<storage, read_write> states: array<atomic<u32>>;
@group(0) @binding(9) var<storage, read_write> totals: array<atomic<u32>, 2>;  // changed matches, compared distances
@group(0) @binding(10) var<storage, read_write> moves: array<vec2<i32>>;

const OPEN = 1u;
const FORWARD = 2u;
const BACKWARD = 4u;
const DRAWS = 5;

var<workgroup> busy: u32;
var<workgroup> parts: array<i64, 2 * ROWS * LANES>;

fn random_bits(position: u64, counter: u64) -> u64 {
    var bits = bitcast<u64>(scan[14]) + position * 0x9E3779B97F4A7C15lu + counter * 0xD1B54A32D192ED03lu;
    bits = (bits ^ (bits >> 30u)) * 0xBF58476D1CE4E5B9lu;
    bits = (bits ^ (bits >> 27u)) * 0x94D049BB133111EBlu;
    return bits ^ (bits >> 31u);
}

fn below(bits: u64, count: i32) -> i32 {
    return i32(((bits & 0xFFFFFFFFlu) * u64(count)) >> 32u);
}

// The number of the patch beside another, or -1.
fn beside(y: i32, x: i32, dy: i32, dx: i32) -> i32 {
    let down = i32(scan[0]);
    let across = i32(scan[1]);
    var ny = y + dy;
    var nx = x + dx;
    if ny < 0 || ny >= down {
        if scan[6] == 0 { return -1; }
        ny += select(-down, down, ny < 0);
    }
    if nx < 0 || nx >= across {
        if scan[7] == 0 { return -1; }
        nx += select(-across, across, nx < 0);
    }
    return ny * across + nx;
}

fn cross(side: i32) -> vec2<i32> {
    return select(vec2(0, side - 2), vec2(side - 1, 0), side % 2 == 0);
}

fn all_propose(y: i32, x: i32, own: vec2<i32>) -> bool {
    for (var side = 0; side < 4; side++) {
        let by = cross(side);
        let at = beside(y, x, by.x, by.y);
        if at >= 0 && any(matches[at] - by != own) { return false; }
    }
    return true;
}

fn random_near(place: vec2<i32>, limit: i64, patch_number: i32, attempt: i32) -> vec2<i32> {
    let radius = i32(scan[16 + attempt]);
    let places = vec2(i32(scan[2]), i32(scan[3]));
    let low = max(place - radius, vec2(0));
    let size = min(place + radius, places - 1) - low + 1;
    for (var draw = 0; draw < DRAWS; draw++) {
        let bits = random_bits(u64(patch_number), u64(attempt * DRAWS + draw));
        let found = low + vec2(below(bits >> 32u, size.x), below(bits, size.y));
        if penalty[found.x * places.y + found.y] <= limit { return found; }
    }
    return vec2(-1);
}

@compute @workgroup_size(ROWS * LANES)
fn sweep(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let across = i32(scan[1]);
    let places = vec2(i32(scan[2]), i32(scan[3]));
    let target_pitch = i32(scan[4]);
    let exemplar_pitch = i32(scan[5]);
    let forward = scan[8] != 0;
    let tries = i32(scan[9]);
    let fills = i32(scan[10]);
    let everywhere = scan[11] != 0;
    let own_penalty = scan[12];
    let strip = strips[group.x];
    let rows = strip.y - strip.x;
    let i = i32(local) / LANES;
    let lane = i32(local) % LANES;
    let step = select(-1, 1, forward);
    let due = select(BACKWARD, FORWARD, forward);
    let other = FORWARD + BACKWARD - due;
    for (var moment = 0; moment < across + rows - 1; moment++) {
        let j = moment - i;
        let y = select(strip.y - 1 - i, strip.x + i, forward);
        let x = select(across - 1 - j, j, forward);
        let at = y * across + x;
        if local == 0u { busy = 0u; }
        workgroupBarrier();
        var visited = false;
        var state = 0u;
        var stays = false;
        var before = vec2(0);
        if i < rows && j >= 0 && j < across {
            state = atomicLoad(&states[at]);
            visited = (state & select(due, ~0u, everywhere)) != 0;
            if visited {
                before = matches[at];
                stays = all_propose(y, x, before);
            }
        }
        if visited && !stays { busy = 1u; }
        let any_busy = workgroupUniformLoad(&busy);
        if visited && lane == 0 {
            atomicStore(&states[at], select(select(state & ~due, OPEN | other, everywhere), 0u, stays));
        }
        visited = visited && !stays;
        if any_busy != 0u {
            var best = before;
            var best_distance = 0li;
            var best_cost = 0li;
            var limit = 0li;
            var omitted = 0;
            if visited {
                best_distance = distances[at];
                let best_penalty = penalty[best.x * places.y + best.y];
                best_cost = best_distance + best_penalty;
                limit = max(scan[13], best_penalty - 1);
                if scan[15] > 0 { omitted = tries - i32(min(i64(tries), best_distance / scan[15])); }
            }
            var last = vec2(-1);
            var compared = 0u;
            for (var attempt = -2; attempt < tries + fills; attempt++) {
                var place = vec2(-1);
                if visited && (attempt < 0 || attempt >= omitted) {
                    if attempt < 0 {
                        let by = select(vec2(0, -step), vec2(-step, 0), attempt == -2);
                        let neighbour = beside(y, x, by.x, by.y);
                        if neighbour >= 0 { place = matches[neighbour] - by; }
                    } else if attempt < tries {
                        place = random_near(best, limit, at, attempt);
                    } else {
                        place = unused_place[below(random_bits(u64(at), u64(attempt * DRAWS)), i32(scan[16 + tries]))];
                    }
                }
                var added = 0li;
                var wanted = all(place >= vec2(0)) && all(place < places);
                if wanted {
                    added = penalty[place.x * places.y + place.y] + own_penalty;
                    wanted = added < best_cost && any(place != best) && any(place != last);
                }
                let half = (attempt & 1) * ROWS * LANES;
                if wanted {
                    let target_start = y * target_pitch + x * CHANNELS;
                    let exemplar_start = place.x * exemplar_pitch + place.y * CHANNELS;
                    var sum = 0li;
                    for (var value = lane; value < SIZE * SIZE * CHANNELS; value += LANES) {
                        let row = value / (SIZE * CHANNELS);
                        let column = value % (SIZE * CHANNELS);
                        let difference = features[target_start + row * target_pitch + column]
                            - exemplar[exemplar_start + row * exemplar_pitch + column];
                        sum += i64(difference * difference);
                    }
                    parts[half + i32(local)] = sum;
                }
                workgroupBarrier();
                if wanted {
                    last = place;
                    compared++;
                    var distance = 0li;
                    for (var part = 0; part < LANES; part++) { distance += parts[half + i * LANES + part]; }
                    if distance + added < best_cost {
                        best_cost = distance + added;
                        best_distance = distance;
                        best = place;
                    }
                }
            }
            if visited && lane == 0 {
                if compared > 0 { atomicAdd(&totals[1], compared); }
                if any(best != before) {
                    let move_number = atomicAdd(&totals[0], 1u);
                    moves[move_number] = vec2(before.x * places.y + before.y, best.x * places.y + best.y);
                    matches[at] = best;
                    distances[at] = best_distance;
                    for (var side = 0; side < 4; side++) {
                        let by = cross(side);
                        let neighbour = beside(y, x, by.x, by.y);
                        if neighbour >= 0 {
                            atomicOr(&states[neighbour], OPEN | select(FORWARD, BACKWARD, side < 2));
                        }
                    }
                }
            }
        }
        storageBarrier();
    }
}
