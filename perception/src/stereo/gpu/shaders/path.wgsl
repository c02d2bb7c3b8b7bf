// Both directions of the paths along one orientation (horizontal, vertical or diagonal), with the
// total-variation edge cost. LANES threads share a path and advance it pixel by pixel, each with four
// disparities at a time. A workgroup has PATHS lines and processes each from both ends at the same time. After the two
// paths have passed each other, the second adds to the results of the first, so no two workgroups share a node.
//
// The source that precedes this file defines LANES (threads per path) and WORDS (maximum words per pixel). Another
// file defines `min_before` and `min_after`.

struct Direction {
    // Step of a forward path: columns, and whether it moves down one row.
    dx: i32,
    down: u32,
    // Weight of a step off and on an image edge, and minimum grey-level difference of an edge.
    flat: u32,
    edge: u32,
    levels: u32,
    truncation: u32,
    // Number of words on either side from which a node can be reached for less than the truncation.
    reach: i32,
    // 0: energies of both directions are merged. 1: jump costs are summed. 2: jump costs are added to the
    // results of other orientations.
    output: u32,
}

@group(0) @binding(0) var<uniform> scale: Scale;
@group(0) @binding(1) var<uniform> direction: Direction;
@group(0) @binding(2) var<storage, read> pictures: array<u32>;
@group(0) @binding(3) var<storage, read> blocks: array<Block>;
@group(0) @binding(4) var<storage, read> data: array<u32>;
@group(0) @binding(5) var<storage, read_write> results: array<u32>;

const HALF = 32u;
const PATHS = HALF / LANES;
const SLOTS = 2u * PATHS;
// Energies of the previous and the current pixel.
var<workgroup> energies: array<u32, 2u * SLOTS * WORDS>;

// A pixel on a path.
struct Pixel {
    x: u32,
    y: u32,
    // Whether the path starts here.
    fresh: bool,
    grey: u32,
    low: u32,
    high: u32,
    // Index of the first word in the volume.
    at: u32,
    weight: u32,
    slope: i32,
}

fn slope_step(slope: i32, before: i32, here: i32) -> i32 {
    return clamp(((slope * here + 128) >> 8u) - ((slope * before + 128) >> 8u), -1, 1);
}

// A pixel that a path enters from a pixel of given grey value; `sign` is 1 forwards, −1 backwards.
fn pixel(x: u32, y: u32, fresh: bool, grey_before: u32, sign: i32) -> Pixel {
    let block = blocks[y / BLOCK * scale.tiles + x / BLOCK];
    let words = end_word(block) - first_word(block);
    var here: Pixel;
    here.x = x;
    here.y = y;
    here.fresh = fresh;
    here.grey = (pictures[y * scale.stride + x / 4u] >> (8u * (x % 4u))) & 0xffu;
    here.low = block.low;
    here.high = block.high;
    here.at = block.at + (y % BLOCK * BLOCK + x % BLOCK) * words;
    here.weight = select(direction.flat, direction.edge, apart(here.grey, grey_before) >= direction.levels);
    let across = direction.down == 0u;
    let slope = select(block.slope_y + direction.dx * block.slope_x, block.slope_x, across);
    let place = i32(select(y, x, across));
    here.slope = slope_step(slope, place - sign, place);
    return here;
}

fn first_pixel(line: u32, backwards: bool, sign: i32) -> Pixel {
    if direction.down == 0u {
        return pixel(select(0u, scale.width - 1u, backwards), line, true, 0u, sign);
    }
    let y = select(0u, scale.height - 1u, backwards);
    let moved = y % scale.width;
    let x = select(line + moved, line + scale.width - moved, direction.dx < 0) % scale.width;
    return pixel(select(x, line, direction.dx == 0), y, true, 0u, sign);
}

// The successor of a pixel; arbitrary after the last one. A diagonal that leaves the image continues at the other
// border as a new path.
fn pixel_after(before: Pixel, sign: i32) -> Pixel {
    let width = i32(scale.width);
    var x = i32(before.x) + sign * direction.dx;
    let fresh = x < 0 || x >= width;
    if fresh {
        x -= width * sign * direction.dx;
    }
    let y = clamp(i32(before.y) + sign * i32(direction.down), 0, i32(scale.height) - 1);
    return pixel(u32(x), u32(y), fresh, before.grey, sign);
}

// Word `k` of the previous energies; words outside `first` to `end` do not exist and are 255.
fn word_before(start: u32, k: i32, first: i32, end: i32) -> u32 {
    if k < first || k >= end {
        return 0xffffffffu;
    }
    return energies[start + u32(k)];
}

// The same, shifted by a slope step.
fn nodes_before(start: u32, k: i32, first: i32, end: i32, slope: i32) -> vec4<u32> {
    var word = word_before(start, k, first, end);
    if slope > 0 {
        word = (word << 8u) | (word_before(start, k - 1, first, end) >> 24u);
    } else if slope < 0 {
        word = (word >> 8u) | (word_before(start, k + 1, first, end) << 24u);
    }
    return unpack4xU8(word);
}

@compute @workgroup_size(64)
fn advance(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let backwards = thread >= HALF;
    let lane = thread % LANES;
    let slot = thread / LANES;
    let across = direction.down == 0u;
    let steps = select(scale.height, scale.width, across);
    let lines = select(scale.width, scale.height, across);
    let line = min(group.x * PATHS + slot % PATHS, lines - 1u);
    let inside = group.x * PATHS + slot % PATHS < lines;
    // With an odd number of pixels the backward paths start one step later, so that both directions never process
    // the same pixel at the same time.
    let lag = steps & 1u;
    let late = select(0u, lag, backwards);
    min_start(thread);
    workgroupBarrier();

    var carried = 0u;
    var first = 0;
    var end = 0;
    let sign = select(1, -1, backwards);
    var next = first_pixel(line, backwards, sign);
    var next_data = data[next.at + min(lane, (next.high + 3u) / 4u - next.low / 4u - 1u)];
    for (var turn = 0u; turn < steps + lag; turn++) {
        let i = turn - late;
        let running = inside && turn >= late && i < steps;
        var least = 255u;
        if running {
            let here = next;
            let data_here = next_data;
            // Prefetch for the next step.
            next = pixel_after(here, sign);
            next_data = data[next.at + min(lane, (next.high + 3u) / 4u - next.low / 4u - 1u)];

            let place = select(i, steps - 1u - i, backwards);
            let ahead = place < steps - 1u - place + lag;
            let is_first = ahead != backwards;
            let min_of_before = min_before(slot, i, carried);
            let low_word = here.low / 4u;
            let high_word = (here.high + 3u) / 4u;
            let before = ((i + 1u) % 2u * SLOTS + slot) * WORDS;
            let after = (i % 2u * SLOTS + slot) * WORDS;
            let w = here.weight;
            for (var word = low_word + lane; word < high_word; word += LANES) {
                let at = here.at + word - low_word;
                var packed = data_here;
                if word >= low_word + LANES {
                    packed = data[at];
                }
                let cost = unpack4xU8(packed);
                var jump = vec4<u32>(0u);
                if !here.fresh {
                    let k = i32(word);
                    // Cheapest transitions from below and from above up to this word. Mostly the neighbouring word is enough.
                    let below = vec4<u32>(3u * w, 2u * w, w, 0u);
                    var up = 1024u;
                    for (var j = max(k - direction.reach, first - 1); j < k - 1; j++) {
                        let v = nodes_before(before, j, first, end, here.slope) + below;
                        up = min(up + 4u * w, min(min(v.x, v.y), min(v.z, v.w)));
                    }
                    let under = nodes_before(before, k - 1, first, end, here.slope) + below;
                    up = min(up + 4u * w, min(min(under.x, under.y), min(under.z, under.w)));
                    let above = vec4<u32>(0u, w, 2u * w, 3u * w);
                    var down = 1024u;
                    for (var j = min(k + direction.reach, end); j > k + 1; j--) {
                        let v = nodes_before(before, j, first, end, here.slope) + above;
                        down = min(down + 4u * w, min(min(v.x, v.y), min(v.z, v.w)));
                    }
                    let over = nodes_before(before, k + 1, first, end, here.slope) + above;
                    down = min(down + 4u * w, min(min(over.x, over.y), min(over.z, over.w)));
                    let own = nodes_before(before, k, first, end, here.slope);
                    var forward: vec4<u32>;
                    forward.x = min(own.x, up + w);
                    forward.y = min(own.y, forward.x + w);
                    forward.z = min(own.z, forward.y + w);
                    forward.w = min(own.w, forward.z + w);
                    var backward: vec4<u32>;
                    backward.w = min(own.w, down + w);
                    backward.z = min(own.z, backward.w + w);
                    backward.y = min(own.y, backward.z + w);
                    backward.x = min(own.x, backward.y + w);
                    let energy = min(min(forward, backward), vec4<u32>(255u));
                    jump = min(energy - vec4<u32>(min_of_before), vec4<u32>(direction.truncation));
                }
                var total = min(cost + jump, vec4<u32>(255u));
                // Nodes outside the window do not exist.
                if word == low_word || word + 1u == high_word {
                    let u = vec4<u32>(4u * word) + vec4<u32>(0u, 1u, 2u, 3u);
                    total = select(total, vec4<u32>(255u), (u < vec4<u32>(here.low)) | (u >= vec4<u32>(here.high)));
                }
                least = min(least, min(min(total.x, total.y), min(total.z, total.w)));
                energies[after + word] = pack4xU8(total);

                if direction.output == 0u {
                    if !is_first {
                        let other = unpack4xU8(results[at]);
                        if scale.merging == 1u {
                            total = min(total, other);
                        } else if scale.merging == 2u {
                            total = (total + other + vec4<u32>(1u)) / 2u;
                        } else if !backwards {
                            total = other;
                        }
                    }
                    results[at] = pack4xU8(total);
                } else {
                    if direction.output == 2u || !is_first {
                        jump = min(jump + unpack4xU8(results[at]), vec4<u32>(255u));
                    }
                    results[at] = pack4xU8(jump);
                }
            }
            first = i32(low_word);
            end = i32(high_word);
        }
        carried = min_after(slot, lane, i, least, running);
        workgroupBarrier();
        if 2u * turn + 4u >= steps {
            // From here on each direction reads what the other has written.
            storageBarrier();
        }
    }
}
