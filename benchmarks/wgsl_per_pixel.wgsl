// Steps of `texloom.stages.kernels.per_pixel.cuda` for texture that is not distorted, bit-identical to it.

@group(0) @binding(0) var<storage, read> step: array<i64, 32>;  // fields of `STEP`
@group(0) @binding(1) var<storage, read> values: array<vec4<i32>>;  // rows of D / 8, two numbers in 32 bits
@group(0) @binding(2) var<storage, read> contributions: array<vec4<i32>>;
@group(0) @binding(3) var<storage, read> candidates: array<i32>;
@group(0) @binding(4) var<storage, read> given: array<vec4<i32>>;
@group(0) @binding(5) var<storage, read_write> states: array<i32>;
@group(0) @binding(6) var<storage, read_write> changed: array<atomic<i32>, 4>;

const HALVES = D / 8;

fn field(number: i32) -> i32 {
    return i32(step[number]);
}

fn floored(a: i32, b: i32) -> i32 {
    return select(a / b, -((b - 1 - a) / b), a < 0);
}

fn random_bits(row: i32, column: i32, counter: u64) -> u64 {
    let position = (u64(bitcast<u32>(row)) << 32u) | u64(bitcast<u32>(column));
    var bits = bitcast<u64>(step[30]) + position * 0x9E3779B97F4A7C15lu + counter * 0xD1B54A32D192ED03lu;
    bits = (bits ^ (bits >> 30u)) * 0xBF58476D1CE4E5B9lu;
    bits = (bits ^ (bits >> 27u)) * 0x94D049BB133111EBlu;
    return bits ^ (bits >> 31u);
}

// The eight numbers of a row, as two vectors of even and odd ones.
fn even(row: vec4<i32>) -> vec4<i32> {
    return (row << vec4(16u)) >> vec4(16u);
}

fn odd(row: vec4<i32>) -> vec4<i32> {
    return row >> vec4(16u);
}

fn squares(one: vec4<i32>) -> i64 {
    let two = vec4<u32>(one * one);  // each is below 2**30
    return i64(two.x) + i64(two.y) + i64(two.z) + i64(two.w);
}

fn distance_of(first: vec4<i32>, second: vec4<i32>, row: vec4<i32>) -> i64 {
    return squares(first - even(row)) + squares(second - odd(row));
}

fn control_distance(pixel: i32, row: i32) -> i64 {
    if HALVES == 1 { return 0li; }
    return distance_of(even(given[pixel]), odd(given[pixel]), values[HALVES * row + 1]);
}

fn snap(place: i32, base: i32) -> i32 {
    return candidates[(base + place) * K];
}

fn started(y: i32, x: i32, pixel: i32) -> i32 {
    let base = field(21) * ROWS * PITCH;
    let spacing = 1 << u32(field(21));
    let at = vec2(field(9) + y, field(10) + x);
    let piece = vec2(floored(at.x, BLOCK), floored(at.y, BLOCK));
    let inside = at - piece * BLOCK;
    let size = vec2(CORE.y - CORE.x, CORE.w - CORE.z);
    let free = select(max(vec2(1), size - (BLOCK - 1) * spacing), size, ENDLESS);
    var least = 1li << 62u;
    var best = 0;
    for (var attempt = 0; attempt < select(1, TRIES, HALVES > 1); attempt++) {
        let bits = random_bits(piece.x, piece.y, u64(attempt));
        var to = vec2(i32((bits >> 32u) % u64(free.x)), i32((bits & 0xFFFFFFFFlu) % u64(free.y))) + inside * spacing;
        if ENDLESS { to = to % size; }
        to = vec2(CORE.x, CORE.z) + min(to, size - 1);
        let stored = snap(to.x * PITCH + to.y, base);
        let off = control_distance(pixel, base + stored);
        if off < least {
            least = off;
            best = stored;
            if off <= step[23] { break; }
        }
    }
    return best;
}

fn refined(y: i32, x: i32) -> i32 {
    let base = field(21) * ROWS * PITCH;
    let row = field(9) + y;
    let column = field(10) + x;
    let parent = states[field(17) + ((row >> 1u) - field(19)) * field(18) + (column >> 1u) - field(20)];
    let bits = random_bits(row, column, 0lu);
    let down_jitter = i32(((i64(bits >> 32u) - (1li << 31u)) * step[22] + (1li << 46u)) >> 47u);
    let across_jitter = i32(((i64(bits & 0xFFFFFFFFlu) - (1li << 31u)) * step[22] + (1li << 46u)) >> 47u);
    let second = vec2(row & 1, column & 1);
    let half = (1 << u32(field(21))) / 2;
    let by = select(second - 1, (second * 2 - 1) * half, half > 0);
    return snap(snap(parent + by.x * PITCH + by.y, base) + down_jitter * PITCH + across_jitter, base);
}

fn beside(u: i32) -> vec2<i32> {
    let number = select(u, u + 1, u > 3);
    return vec2(number / 3 - 1, number % 3 - 1);
}

fn corrected(y: i32, x: i32, local: i32, pixel: i32) -> i32 {
    let base = field(21) * ROWS * PITCH;
    let spacing = 1 << u32(field(21));
    let own = states[field(12) + local];
    var stored: array<i32, 8>;
    var predicted: array<i32, 8>;
    var same = true;
    for (var u = 0; u < 8; u++) {
        let by = beside(u);
        let source = field(select(select(15, 13, by.y == 0), 14, by.x == 0));
        stored[u] = states[source + local + by.x * field(8) + by.y];
        predicted[u] = stored[u] - (by.x * PITCH + by.y) * spacing;
        same = same && predicted[u] == own;
    }
    if same && control_distance(pixel, base + own) <= step[23] { return own; }
    var first = vec4(0);
    var second = vec4(0);
    if same {
        first = even(values[HALVES * (base + own)]);
        second = odd(values[HALVES * (base + own)]);
    } else {
        for (var u = 0; u < 8; u++) {
            let row = contributions[u * LEVELS * ROWS * PITCH + base + stored[u]];
            first += even(row);
            second += odd(row);
        }
    }
    var least = 1li << 62u;
    var best = own;
    for (var u = 0; u < 9; u++) {
        var place = own;
        if u > 0 { place = predicted[u - 1]; }
        var agree = 0li;
        for (var v = 0; v < 8; v++) { agree += select(0li, 1li, predicted[v] == place); }
        var off = distance_of(first, second, values[HALVES * (base + place)]) * (256li - COHERENCE * agree);
        off = (off + control_distance(pixel, base + place) * (256li - CONTROL * agree)) >> 8u;
        if off < least {
            least = off;
            best = place;
        }
    }
    for (var k = 1; k < K; k++) {
        for (var u = 0; u < 9; u++) {
            var place = own;
            var moved = 0;
            if u > 0 {
                place = stored[u - 1];
                moved = (beside(u - 1).x * PITCH + beside(u - 1).y) * spacing;
            }
            place = candidates[(base + place) * K + k] - moved;
            let off = distance_of(first, second, values[HALVES * (base + place)])
                + control_distance(pixel, base + place);
            if off < least {
                least = off;
                best = place;
            }
        }
    }
    return snap(best, base);
}

@compute @workgroup_size(64)
fn run(@builtin(global_invocation_id) id: vec3<u32>) {
    let stride = field(5);
    let y = field(1) + i32(id.y) * stride;
    let x = field(3) + i32(id.x) * stride;
    if y >= field(2) || x >= field(4) { return; }
    let rows = field(7);
    let columns = field(8);
    let local = y * columns + x;
    let pixel = field(6) + local;
    var stored = 0;
    switch field(0) {
        case 0: { stored = started(y, x, pixel); }
        case 1: { stored = refined(y, x); }
        default: { stored = corrected(y, x, local, pixel); }
    }
    let after = field(16);
    if states[after + local] == stored { return; }
    states[after + local] = stored;
    var over = vec2(y, x);
    if (field(11) & 1) != 0 { over.x = select(select(y, 0, y == rows - 2), rows - 1, y == 1); }
    if (field(11) & 2) != 0 { over.y = select(select(x, 0, x == columns - 2), columns - 1, x == 1); }
    states[after + over.x * columns + x] = stored;
    states[after + y * columns + over.y] = stored;
    states[after + over.x * columns + over.y] = stored;
    if field(24) != 0 {
        atomicMin(&changed[0], y);
        atomicMax(&changed[1], y + 1);
        atomicMin(&changed[2], x);
        atomicMax(&changed[3], x + 1);
    }
}
