// Winner-take-all: the winner of each pixel, its sub-pixel refinement and confidence, and its projection to the right
// view.

@group(0) @binding(0) var<uniform> scale: Scale;
@group(0) @binding(1) var<storage, read> blocks: array<Block>;
// H, and the jump costs of the six other paths.
@group(0) @binding(2) var<storage, read> merged: array<u32>;
@group(0) @binding(3) var<storage, read> jumps: array<u32>;
// Disparity in 1/256 px, integer disparity, confidence.
@group(0) @binding(4) var<storage, read_write> winners: array<u32>;
// The right view: of the winners that project to a pixel the one of minimum energy, of equals the greatest
// disparity. 255 − energy in the upper byte, the disparity in the lower.
@group(0) @binding(5) var<storage, read_write> right_view: array<atomic<u32>>;

// Words of a pixel plus one, so that neighbours lie in different banks.
const STRIDE = WORDS + 1u;
var<workgroup> totals: array<u32, BLOCK * STRIDE>;

fn total_of(pixel: u32, node: u32) -> u32 {
    return (totals[pixel * STRIDE + node / 4u] >> (8u * (node % 4u))) & 0xffu;
}

fn data_of(at: u32, node: u32) -> i32 {
    return i32((merged[at + node / 4u] >> (8u * (node % 4u))) & 0xffu);
}

@compute @workgroup_size(64)
fn pick(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let y = group.y;
    let block = blocks[y / BLOCK * scale.tiles + group.x];
    let low_word = first_word(block);
    let words = end_word(block) - low_word;
    let row = block.at + y % BLOCK * BLOCK * words;
    for (var i = thread; i < BLOCK * words; i += 64u) {
        let sum = unpack4xU8(merged[row + i]) + unpack4xU8(jumps[row + i]);
        totals[i / words * STRIDE + i % words] = pack4xU8(min(sum, vec4<u32>(255u)));
    }
    workgroupBarrier();
    let x = group.x * BLOCK + thread;
    if thread >= BLOCK || x >= scale.width {
        return;
    }
    // Nodes are counted from the first disparity of the first word.
    let start = block.low - 4u * low_word;
    let end = start + block.high - block.low;
    var best = 255u;
    var place = start;
    for (var node = start; node < end; node++) {
        let energy = total_of(thread, node);
        if energy < best {
            best = energy;
            place = node;
        }
    }
    var second = 255u;
    for (var node = start; node < end; node++) {
        if node + 1u < place || node > place + 1u {
            second = min(second, total_of(thread, node));
        }
    }
    let margin = second - min(second, best);
    var confidence = min(min(2u * margin, 255u) + (margin + 1u) / 2u, 255u);
    // A truncated window excludes competing nodes.
    let cut_low = block.low > 0u;
    let cut_high = block.high < scale.disparities;
    if cut_low || cut_high {
        let doubt = ((best + 1u) / 2u + 1u) / 2u;
        confidence -= min(confidence, doubt);
    }
    if (cut_low && place == start) || (cut_high && place + 1u == end) {
        confidence = 1u;
    }
    confidence = max(confidence, 1u);

    let here = i32(best);
    let at = row + thread * words;
    let data = data_of(at, place);
    var before = here;
    var after = here;
    var data_before = data;
    var data_after = data;
    if place > start && place + 1u < end {
        before = i32(total_of(thread, place - 1u));
        after = i32(total_of(thread, place + 1u));
        data_before = data_of(at, place - 1u);
        data_after = data_of(at, place + 1u);
    }
    // Equiangular fit, to H if the winner is a minimum of H as well; `lean` is the difference of the jump costs
    // before and after, of which an eighth is used.
    var lean = 0;
    var middle = here;
    if scale.sub_pixel == 2u && data_before > data && data_after > data {
        lean = (before - data_before) - (after - data_after);
        before = data_before;
        after = data_after;
        middle = data;
    }
    var part = 0;
    if scale.sub_pixel != 0u {
        let slope = 8 * max(max(before - middle, after - middle), 1) + abs(lean);
        part = clamp(128 * (8 * (before - after) + lean) / slope, -128, 128);
    }
    let whole = place - start + block.low;
    let disparity = u32(i32(whole) * 256 + part) & 0xffffu;
    winners[y * scale.width + x] = disparity | (confidence << 16u) | (whole << 24u);
    if x >= whole {
        atomicMax(&right_view[y * scale.width + x - whole], ((255u - best) << 8u) | whole);
    }
}
