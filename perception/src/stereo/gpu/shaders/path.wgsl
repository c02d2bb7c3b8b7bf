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
// Energies of the previous and the current pixel, each with a word of 255 before and after its window.
const STRIDE = WORDS + 2u;
var<workgroup> energies: array<u32, 2u * SLOTS * STRIDE>;

// Steps from the request of a pixel's words to their use: a step takes a few hundred cycles, a load from memory several times that.
const AHEAD = 4u;
// Turns between two barriers of the results, where they are not needed in each.
const BETWEEN = 8u;

// A pixel on a path, whose words of the volumes have been requested.
struct Pixel {
    // Whether the path starts here.
    fresh: bool,
    grey: u32,
    low: u32,
    high: u32,
    // Index of the first word in the volume.
    at: u32,
    slope: i32,
    // The first words of this lane, of the data and of what other paths left.
    data: vec2<u32>,
    results: vec2<u32>,
}

// One of the two ends of a line: where it requests next, what it knows of that pixel, and what it knows of the last one it processed.
struct End {
    sign: i32,
    lane: u32,
    // Place that is requested next, its block and the word with its grey value: both requested a step ago.
    x: u32,
    y: u32,
    fresh: bool,
    block: Block,
    grey: u32,
    // Grey value, window in words and minimum energy of the pixel before.
    grey_before: u32,
    first: i32,
    end: i32,
    carried: u32,
}

fn slope_step(slope: i32, before: i32, here: i32) -> i32 {
    return clamp(((slope * here + 128) >> 8u) - ((slope * before + 128) >> 8u), -1, 1);
}

// Requests the block and the grey value of the place of an end.
fn look(end: ptr<function, End>) {
    let x = (*end).x;
    let y = (*end).y;
    (*end).block = blocks[y / BLOCK * scale.tiles + x / BLOCK];
    (*end).grey = pictures[y * scale.stride + x / 4u];
}

fn begin(end: ptr<function, End>, line: u32, backwards: bool) {
    if direction.down == 0u {
        (*end).x = select(0u, scale.width - 1u, backwards);
        (*end).y = line;
    } else {
        let y = select(0u, scale.height - 1u, backwards);
        let moved = y % scale.width;
        let x = select(line + moved, line + scale.width - moved, direction.dx < 0) % scale.width;
        (*end).x = select(x, line, direction.dx == 0);
        (*end).y = y;
    }
    (*end).fresh = true;
    look(end);
}

// Requests the words of the pixel at which an end is, and moves on; arbitrary after the last one. A diagonal that leaves the image
// continues at the other border as a new path.
fn request(end: ptr<function, End>) -> Pixel {
    let x = (*end).x;
    let y = (*end).y;
    let sign = (*end).sign;
    let block = (*end).block;
    let words = end_word(block) - first_word(block);
    var pixel: Pixel;
    pixel.fresh = (*end).fresh;
    pixel.grey = ((*end).grey >> (8u * (x % 4u))) & 0xffu;
    pixel.low = block.low;
    pixel.high = block.high;
    pixel.at = block.at + (y % BLOCK * BLOCK + x % BLOCK) * words;
    let one = pixel.at + min((*end).lane, words - 1u);
    let two = pixel.at + min((*end).lane + LANES, words - 1u);
    pixel.data = vec2<u32>(data[one], data[two]);
    pixel.results = vec2<u32>(results[one], results[two]);
    let across = direction.down == 0u;
    let slope = select(block.slope_y + direction.dx * block.slope_x, block.slope_x, across);
    let place = i32(select(y, x, across));
    pixel.slope = slope_step(slope, place - sign, place);

    let width = i32(scale.width);
    var next = i32(x) + sign * direction.dx;
    (*end).fresh = next < 0 || next >= width;
    if (*end).fresh {
        next -= width * sign * direction.dx;
    }
    (*end).x = u32(next);
    (*end).y = u32(clamp(i32(y) + sign * i32(direction.down), 0, i32(scale.height) - 1));
    look(end);
    return pixel;
}

// Word `k` of the previous energies; words outside `first` to `end` do not exist and are 255.
fn word_before(start: u32, k: i32, first: i32, end: i32) -> u32 {
    return energies[u32(i32(start) + clamp(k, first - 1, end))];
}

// A word shifted by a slope step, with its neighbours from below and from above.
fn shifted(below: u32, word: u32, above: u32, slope: i32) -> vec4<u32> {
    let up = (word << 8u) | (below >> 24u);
    let down = (word >> 8u) | (above << 24u);
    return unpack4xU8(select(select(word, up, slope > 0), down, slope < 0));
}

fn nodes_before(start: u32, k: i32, first: i32, end: i32, slope: i32) -> vec4<u32> {
    let below = word_before(start, k - 1, first, end);
    let above = word_before(start, k + 1, first, end);
    return shifted(below, word_before(start, k, first, end), above, slope);
}

// A line in the turns of its workgroup.
struct Line {
    // Whether it exists, and whether this thread works backwards on it.
    inside: bool,
    backwards: bool,
    slot: u32,
    steps: u32,
    // With an odd number of pixels the backward paths start one step later, so that both directions never process
    // the same pixel at the same time.
    lag: u32,
    late: u32,
}

// Processes the pixel of this turn and requests the one AHEAD of it.
fn process(line: Line, end: ptr<function, End>, pixel: ptr<function, Pixel>, turn: u32) {
    let steps = line.steps;
    let backwards = line.backwards;
    let slot = line.slot;
    let lane = (*end).lane;
    let i = turn - line.late;
    let running = line.inside && turn >= line.late && i < steps;
    var least = 255u;
    if running {
        let here = *pixel;
        *pixel = request(end);

        let place = select(i, steps - 1u - i, backwards);
        let ahead = place < steps - 1u - place + line.lag;
        let is_first = ahead != backwards;
        // Whether the words of the results were what they are now when they were requested: the other direction has not been here,
        // or was before that.
        let settled = is_first || steps - 1u - i + line.lag + AHEAD + BETWEEN < i + 2u * line.late;
        let min_of_before = min_before(slot, i, (*end).carried);
        let first = (*end).first;
        let last = (*end).end;
        let low_word = here.low / 4u;
        let high_word = (here.high + 3u) / 4u;
        let before = ((i + 1u) % 2u * SLOTS + slot) * STRIDE + 1u;
        let after = (i % 2u * SLOTS + slot) * STRIDE + 1u;
        if lane < 2u {
            energies[after + select(low_word - 1u, high_word, lane == 1u)] = 0xffffffffu;
        }
        let w = select(direction.flat, direction.edge, apart(here.grey, (*end).grey_before) >= direction.levels);
        var n = 0u;
        for (var word = low_word + lane; word < high_word; word += LANES) {
            let at = here.at + word - low_word;
            var packed = select(here.data.x, here.data.y, n == 1u);
            if n > 1u {
                packed = data[at];
            }
            let cost = unpack4xU8(packed);
            var jump = vec4<u32>(0u);
            if !here.fresh {
                let k = i32(word);
                let two_under = word_before(before, k - 2, first, last);
                let one_under = word_before(before, k - 1, first, last);
                let middle = word_before(before, k, first, last);
                let one_over = word_before(before, k + 1, first, last);
                let two_over = word_before(before, k + 2, first, last);
                // Cheapest transitions from below and from above up to this word. Mostly the neighbouring word is enough.
                let below = vec4<u32>(3u * w, 2u * w, w, 0u);
                var up = 1024u;
                for (var j = max(k - direction.reach, first - 1); j < k - 1; j++) {
                    let v = nodes_before(before, j, first, last, here.slope) + below;
                    up = min(up + 4u * w, min(min(v.x, v.y), min(v.z, v.w)));
                }
                let under = shifted(two_under, one_under, middle, here.slope) + below;
                up = min(up + 4u * w, min(min(under.x, under.y), min(under.z, under.w)));
                let above = vec4<u32>(0u, w, 2u * w, 3u * w);
                var down = 1024u;
                for (var j = min(k + direction.reach, last); j > k + 1; j--) {
                    let v = nodes_before(before, j, first, last, here.slope) + above;
                    down = min(down + 4u * w, min(min(v.x, v.y), min(v.z, v.w)));
                }
                let over = shifted(middle, one_over, two_over, here.slope) + above;
                down = min(down + 4u * w, min(min(over.x, over.y), min(over.z, over.w)));
                let own = shifted(one_under, middle, one_over, here.slope);
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

            var other = vec4<u32>(0u);
            if direction.output == 2u || !is_first {
                var left = select(here.results.x, here.results.y, n == 1u);
                if n > 1u || !settled {
                    left = results[at];
                }
                other = unpack4xU8(left);
            }
            if direction.output == 0u {
                if !is_first {
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
                results[at] = pack4xU8(min(jump + other, vec4<u32>(255u)));
            }
            n++;
        }
        (*end).grey_before = here.grey;
        (*end).first = i32(low_word);
        (*end).end = i32(high_word);
    }
    (*end).carried = min_after(slot, lane, i, least, running);
    workgroupBarrier();
    // From here on each direction reads what the other has written: at first what it has just written, then what it wrote before.
    if 2u * (turn + AHEAD) >= steps && (2u * turn <= steps + 4u * BETWEEN || turn % BETWEEN == 0u) {
        storageBarrier();
    }
}

@compute @workgroup_size(64)
fn advance(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let across = direction.down == 0u;
    let lines = select(scale.width, scale.height, across);
    var line: Line;
    line.backwards = thread >= HALF;
    line.slot = thread / LANES;
    line.steps = select(scale.height, scale.width, across);
    line.lag = line.steps & 1u;
    line.late = select(0u, line.lag, line.backwards);
    let number = group.x * PATHS + line.slot % PATHS;
    line.inside = number < lines;
    min_start(thread);
    workgroupBarrier();

    var end: End;
    end.sign = select(1, -1, line.backwards);
    end.lane = thread % LANES;
    begin(&end, min(number, lines - 1u), line.backwards);
    // The pixels of the next AHEAD turns.
    var a = request(&end);
    var b = request(&end);
    var c = request(&end);
    var d = request(&end);
    if line.late == 1u {
        // The first turn is not theirs.
        let spare = d;
        d = c;
        c = b;
        b = a;
        a = spare;
    }
    for (var turn = 0u; turn < line.steps + line.lag; turn += AHEAD) {
        process(line, &end, &a, turn);
        process(line, &end, &b, turn + 1u);
        process(line, &end, &c, turn + 2u);
        process(line, &end, &d, turn + 3u);
    }
}
