// Post-processing of the finest map: confidence of the neighbourhood, median, hole interpolation. Each kernel reads
// one map and writes another.

@group(0) @binding(0) var<uniform> scale: Scale;
@group(0) @binding(1) var<storage, read> before: array<u32>;
@group(0) @binding(2) var<storage, read_write> after: array<u32>;

fn at(x: i32, y: i32) -> u32 {
    if x < 0 || y < 0 || x >= i32(scale.width) || y >= i32(scale.height) {
        return 0u;
    }
    return before[u32(y) * scale.width + u32(x)];
}

// Replaces the confidence by the mean over 5 × 5 pixels; unknown pixels count as 0.
@compute @workgroup_size(64)
fn filter_confidence(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= scale.width {
        return;
    }
    let x = i32(id.x);
    let y = i32(id.y);
    var sum = 0u;
    for (var dy = -2; dy <= 2; dy++) {
        for (var dx = -2; dx <= 2; dx++) {
            sum += confidence_of(at(x + dx, y + dy));
        }
    }
    let confidence = max(sum / 25u, 1u);
    let disparity = select(disparity_of(at(x, y)), 0u, confidence < scale.min_filtered_confidence);
    after[id.y * scale.width + id.x] = disparity | (confidence << 16u);
}

var<private> values: array<u32, 9>;

fn exchange(a: u32, b: u32) {
    let low = min(values[a], values[b]);
    values[b] = max(values[a], values[b]);
    values[a] = low;
}

// 3 × 3 median; an unknown neighbour counts as the pixel itself, unknown pixels are kept.
@compute @workgroup_size(64)
fn median(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= scale.width {
        return;
    }
    let x = i32(id.x);
    let y = i32(id.y);
    let here = at(x, y);
    let own = disparity_of(here);
    var result = 0u;
    if own > 0u {
        for (var i = 0; i < 9; i++) {
            let neighbour = disparity_of(at(x + i % 3 - 1, y + i / 3 - 1));
            values[i] = select(neighbour, own, neighbour == 0u);
        }
        exchange(1u, 2u);
        exchange(4u, 5u);
        exchange(7u, 8u);
        exchange(0u, 1u);
        exchange(3u, 4u);
        exchange(6u, 7u);
        exchange(1u, 2u);
        exchange(4u, 5u);
        exchange(7u, 8u);
        exchange(0u, 3u);
        exchange(5u, 8u);
        exchange(4u, 7u);
        exchange(3u, 6u);
        exchange(1u, 4u);
        exchange(2u, 5u);
        exchange(4u, 7u);
        exchange(4u, 2u);
        exchange(6u, 4u);
        exchange(4u, 2u);
        result = values[4];
    }
    after[id.y * scale.width + id.x] = (here & 0xff0000u) | result;
}

// Interpolation between the two ends of a hole of `length` pixels, `part` pixels from the first end; unknown
// where they are too far apart. `step` is the offset from one pixel to the next.
fn bridged(first_end: u32, second_end: u32, part: i32, length: i32) -> u32 {
    let a = disparity_of(first_end);
    let b = disparity_of(second_end);
    if a == 0u || b == 0u || length > i32(scale.bridge_px) || apart(a, b) > scale.bridge_step {
        return 0u;
    }
    let value = max(i32(a) + (i32(b) - i32(a)) * part / (length + 1), 1);
    let confidence = max(min(confidence_of(first_end), confidence_of(second_end)) / 4u, 1u);
    return u32(value) | (confidence << 16u);
}

fn bridge(x: i32, y: i32, dx: i32, dy: i32) -> u32 {
    let here = at(x, y);
    if disparity_of(here) > 0u {
        return here;
    }
    let most = i32(scale.bridge_px);
    var back = 1;
    while back <= most && disparity_of(at(x - back * dx, y - back * dy)) == 0u {
        back++;
    }
    var ahead = 1;
    while ahead <= most && disparity_of(at(x + ahead * dx, y + ahead * dy)) == 0u {
        ahead++;
    }
    let filled = bridged(
        at(x - back * dx, y - back * dy), at(x + ahead * dx, y + ahead * dy), back, back + ahead - 1);
    return select(filled, here, filled == 0u);
}

@compute @workgroup_size(64)
fn bridge_rows(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < scale.width {
        after[id.y * scale.width + id.x] = bridge(i32(id.x), i32(id.y), 1, 0);
    }
}

@compute @workgroup_size(64)
fn bridge_columns(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < scale.width {
        after[id.y * scale.width + id.x] = bridge(i32(id.x), i32(id.y), 0, 1);
    }
}

// Packs the download: disparities, two per word, then confidences, four per word.
@compute @workgroup_size(64)
fn pack(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixels = scale.width * scale.height;
    let four = id.y * 65535u * 64u + id.x;
    if 4u * four >= pixels {
        return;
    }
    var value: array<u32, 4>;
    for (var i = 0u; i < 4u; i++) {
        if 4u * four + i < pixels {
            value[i] = before[4u * four + i];
        }
    }
    after[2u * four] = disparity_of(value[0]) | (disparity_of(value[1]) << 16u);
    after[2u * four + 1u] = disparity_of(value[2]) | (disparity_of(value[3]) << 16u);
    after[(pixels + 3u) / 4u * 2u + four] = confidence_of(value[0]) | (confidence_of(value[1]) << 8u)
        | (confidence_of(value[2]) << 16u) | (confidence_of(value[3]) << 24u);
}
