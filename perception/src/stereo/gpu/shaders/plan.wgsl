// Search windows and slopes of the blocks, from the map of the next coarser scale.

@group(0) @binding(0) var<uniform> scale: Scale;
@group(0) @binding(1) var<storage, read> coarse: array<u32>;
// The coarser map in integer disparities of this scale, with holes filled from the farther side.
@group(0) @binding(2) var<storage, read_write> seeds: array<u32>;
@group(0) @binding(3) var<storage, read_write> blocks: array<Block>;
struct Plan {
    // Maximum window size within the budget.
    widest: u32,
    // Number of nodes of all windows, for the pixels of the image.
    nodes: u32,
    spare: u32,
    spare_2: u32,
}
@group(0) @binding(4) var<storage, read_write> plan: Plan;

const GRAIN = 2u;
const MARGIN = 2u;
const AROUND = 6u;
const SLOPE_BASE = 4u;
const EDGE = 614;
const GAIN = 11;
const CELL = 8u;
const MIN_MEASURES = 32;

fn coarse_disparity(x: u32, y: u32) -> u32 {
    return disparity_of(coarse[y * scale.coarse_width + x]);
}

fn whole(disparity: u32) -> u32 {
    return max(min((disparity + 64u) >> 7u, min(scale.disparities - 1u, 255u)), 1u);
}

@compute @workgroup_size(64)
fn seed(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = id.x;
    let y = id.y;
    if x >= scale.coarse_width {
        return;
    }
    let here = coarse_disparity(x, y);
    var value = 0u;
    if here > 0u {
        value = whole(here);
    } else {
        var before = 0u;
        for (var left = x; left > 0u && before == 0u; left--) {
            before = coarse_disparity(left - 1u, y);
        }
        if before > 0u {
            before = whole(before);
        }
        var after = 0u;
        for (var right = x + 1u; right < scale.coarse_width && after == 0u; right++) {
            after = coarse_disparity(right, y);
        }
        if after > 0u {
            after = whole(after);
        } else {
            after = before;
        }
        value = select(min(before, after), after, before == 0u);
    }
    seeds[y * scale.coarse_width + x] = value;
}

var<workgroup> steps: array<atomic<i32>, 4>;

fn slope_of(sum: i32, count: i32) -> i32 {
    if count < MIN_MEASURES {
        return 0;
    }
    return clamp(sum * GAIN / (i32(SLOPE_BASE) * count * 10), -128, 128);
}

// One workgroup per block.
@compute @workgroup_size(64)
fn slopes(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    if thread < 4u {
        atomicStore(&steps[thread], 0);
    }
    workgroupBarrier();
    // The cells of the block and one more on each side.
    let half = BLOCK / 2u;
    let left = (max(group.x * half / CELL, 1u) - 1u) * CELL;
    let top = (max(group.y * half / CELL, 1u) - 1u) * CELL;
    let right = min((((group.x + 1u) * half + CELL - 1u) / CELL + 1u) * CELL, scale.coarse_width);
    let bottom = min((((group.y + 1u) * half + CELL - 1u) / CELL + 1u) * CELL, scale.coarse_height);
    let columns = right - left;
    let rows = (bottom - top + 1u) / 2u;
    var sum = vec2<i32>(0);
    var count = vec2<i32>(0);
    for (var i = thread; i < columns * rows; i += 64u) {
        let x = left + i % columns;
        // Every other row is enough.
        let y = top + 2u * (i / columns);
        let here = i32(coarse_disparity(x, y));
        if here > 0 && x + SLOPE_BASE < scale.coarse_width {
            let there = i32(coarse_disparity(x + SLOPE_BASE, y));
            if there > 0 && abs(there - here) < EDGE {
                sum.x += there - here;
                count.x += 1;
            }
        }
        if here > 0 && y + SLOPE_BASE < scale.coarse_height {
            let there = i32(coarse_disparity(x, y + SLOPE_BASE));
            if there > 0 && abs(there - here) < EDGE {
                sum.y += there - here;
                count.y += 1;
            }
        }
    }
    atomicAdd(&steps[0], sum.x);
    atomicAdd(&steps[1], count.x);
    atomicAdd(&steps[2], sum.y);
    atomicAdd(&steps[3], count.y);
    workgroupBarrier();
    if thread == 0u {
        let index = group.y * scale.tiles + group.x;
        blocks[index].slope_x = slope_of(atomicLoad(&steps[0]), atomicLoad(&steps[1]));
        blocks[index].slope_y = slope_of(atomicLoad(&steps[2]), atomicLoad(&steps[3]));
    }
}

// Minimum disparity minus one (so that 0, unknown, becomes the maximum of the type), maximum disparity, and start of
// the range with most pixels: pixel count in the upper bytes, 255 − start in the lowest.
var<workgroup> ends: array<atomic<u32>, 3>;
var<workgroup> histogram: array<atomic<u32>, 256>;

fn set_window(index: u32, widest: u32, thread: u32) {
    for (var i = thread; i < 256u; i += 64u) {
        atomicStore(&histogram[i], 0u);
    }
    if thread == 0u {
        atomicStore(&ends[0], 255u);
        atomicStore(&ends[1], 0u);
        atomicStore(&ends[2], 0u);
    }
    workgroupBarrier();
    let tile = index % scale.tiles;
    let strip = index / scale.tiles;
    let left = (max(tile * BLOCK, AROUND) - AROUND) / 2u;
    let right = min(((tile + 1u) * BLOCK + AROUND) / 2u, scale.coarse_width);
    let top = (max(strip * BLOCK, AROUND) - AROUND) / 2u;
    let bottom = min(max(min(((strip + 1u) * BLOCK + AROUND) / 2u, scale.coarse_height), top + 1u), scale.coarse_height);
    let columns = right - left;
    for (var i = thread; i < columns * (bottom - top); i += 64u) {
        let seed = seeds[(top + i / columns) * scale.coarse_width + left + i % columns];
        atomicMin(&ends[0], (seed + 255u) & 0xffu);
        atomicMax(&ends[1], seed);
        atomicAdd(&histogram[seed], 1u);
    }
    workgroupBarrier();
    let last = atomicLoad(&ends[1]);
    let first = atomicLoad(&ends[0]) + 1u;
    var low = 0u;
    var span = min(scale.disparities, widest);
    var inner = 0u;
    var narrow = false;
    if last > 0u {
        let need = (last - first + 2u * MARGIN + 1u + GRAIN - 1u) / GRAIN * GRAIN;
        span = min(min(need, widest), scale.disparities);
        inner = max(max(span, 2u * MARGIN) - 2u * MARGIN, 1u);
        narrow = last - first >= inner;
        if narrow {
            // Start of the range with most pixels; of equals the smallest.
            for (var start = first + thread; start <= last; start += 64u) {
                var count = 0u;
                for (var i = start; i < min(start + inner, 256u); i++) {
                    count += atomicLoad(&histogram[i]);
                }
                atomicMax(&ends[2], (count << 8u) | (255u - start));
            }
        }
    }
    workgroupBarrier();
    if last > 0u {
        var middle_twice = first + last;
        if narrow {
            middle_twice = 2u * (255u - (atomicLoad(&ends[2]) & 0xffu)) + inner - 1u;
        }
        low = min((max(middle_twice + 1u, span) - span) / 2u, scale.disparities - span);
    }
    if thread == 0u {
        blocks[index].low = low;
        blocks[index].high = low + span;
    }
}

// One workgroup per block.
@compute @workgroup_size(64)
fn windows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    set_window(group.x, scale.widest, thread);
}

// The same, limited to the budget.
@compute @workgroup_size(64)
fn windows_again(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    set_window(group.x, plan.widest, thread);
}

var<workgroup> widest_found: atomic<u32>;

// Vectors of a block's row in the CPU's volume, the unit of the budget.
fn pitch(span: u32) -> u32 {
    return select(span, span + 2u, span % 32u == 0u);
}

// Maximum window size with which all blocks stay within the budget. One workgroup.
@compute @workgroup_size(64)
fn limit(@builtin(local_invocation_index) thread: u32) {
    if thread == 0u {
        atomicStore(&widest_found, GRAIN);
    }
    workgroupBarrier();
    for (var less = thread * GRAIN; less < scale.widest; less += 64u * GRAIN) {
        let widest = scale.widest - less;
        var vectors = 0u;
        for (var i = 0u; i < scale.tiles * scale.strips; i++) {
            let block = blocks[i];
            vectors += pitch(min(block.high - block.low, widest)) * BLOCK;
        }
        if vectors <= scale.budget {
            atomicMax(&widest_found, widest);
        }
    }
    workgroupBarrier();
    if thread == 0u {
        plan.widest = atomicLoad(&widest_found);
    }
}

var<workgroup> sums: array<u32, 64>;
var<workgroup> nodes_found: atomic<u32>;

// Assigns the blocks their positions in the volumes. One workgroup.
@compute @workgroup_size(64)
fn lay_out(@builtin(local_invocation_index) thread: u32) {
    let count = scale.tiles * scale.strips;
    let share = (count + 63u) / 64u;
    let start = min(thread * share, count);
    let end = min(start + share, count);
    if thread == 0u {
        atomicStore(&nodes_found, 0u);
    }
    workgroupBarrier();
    var sum = 0u;
    var nodes = 0u;
    for (var i = start; i < end; i++) {
        let block = blocks[i];
        sum += (end_word(block) - first_word(block)) * BLOCK * BLOCK;
        let columns = min(BLOCK, scale.width - i % scale.tiles * BLOCK);
        let rows = min(BLOCK, scale.height - i / scale.tiles * BLOCK);
        nodes += columns * rows * (block.high - block.low);
    }
    sums[thread] = sum;
    atomicAdd(&nodes_found, nodes);
    workgroupBarrier();
    var at = 0u;
    for (var i = 0u; i < thread; i++) {
        at += sums[i];
    }
    for (var i = start; i < end; i++) {
        let block = blocks[i];
        blocks[i].at = at;
        at += (end_word(block) - first_word(block)) * BLOCK * BLOCK;
    }
    if thread == 0u {
        plan.nodes = atomicLoad(&nodes_found);
    }
}
