// Speckle filter. Rows are cut into runs of connected pixels, and runs that touch in neighbouring rows are united; the
// smallest pixel index of a region is its label.

@group(0) @binding(0) var<uniform> scale: Scale;
@group(0) @binding(1) var<storage, read_write> map: array<u32>;
// Index of a pixel of the same region with a smaller index, or of the pixel itself.
@group(0) @binding(2) var<storage, read_write> labels: array<atomic<u32>>;
// Number of pixels of the run that starts here, later of the region.
@group(0) @binding(3) var<storage, read_write> counts: array<atomic<u32>>;

fn alike(a: u32, b: u32) -> bool {
    return a > 0u && b > 0u && apart(a, b) <= scale.speckle_step;
}

// Whether a run starts at a pixel.
fn begins(row: u32, x: u32) -> bool {
    return x == 0u || !alike(disparity_of(map[row + x]), disparity_of(map[row + x - 1u]));
}

// Start of the last run in each thread's part plus one; 0 for none.
var<workgroup> last_begin: array<u32, 64>;

// One workgroup per row.
@compute @workgroup_size(64)
fn runs(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = group.x * scale.width;
    let share = (scale.width + 63u) / 64u;
    let start = min(thread * share, scale.width);
    let end = min(start + share, scale.width);
    var last = 0u;
    for (var x = start; x < end; x++) {
        if begins(row, x) {
            last = x + 1u;
        }
    }
    last_begin[thread] = last;
    workgroupBarrier();
    var run = 0u;
    for (var before = thread; before > 0u; before--) {
        let begin = last_begin[before - 1u];
        if begin > 0u {
            run = begin - 1u;
            break;
        }
    }
    for (var x = start; x < end; x++) {
        if begins(row, x) {
            run = x;
        }
        atomicStore(&labels[row + x], row + run);
        if x + 1u == scale.width || begins(row, x + 1u) {
            atomicStore(&counts[row + run], x + 1u - run);
        }
    }
}

fn root_of(pixel: u32) -> u32 {
    var at = pixel;
    loop {
        let up = atomicLoad(&labels[at]);
        if up == at {
            break;
        }
        at = up;
    }
    return at;
}

fn unite(first: u32, second: u32) {
    var a = root_of(first);
    var b = root_of(second);
    while a != b {
        let high = max(a, b);
        let low = min(a, b);
        let old = atomicMin(&labels[high], low);
        if old == high {
            return;
        }
        // Another thread was faster: join with its result as well.
        a = root_of(old);
        b = root_of(low);
    }
}

@compute @workgroup_size(64)
fn join(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = id.x;
    let y = id.y + 1u;
    if x >= scale.width {
        return;
    }
    let row = y * scale.width;
    let above = row - scale.width;
    if !alike(disparity_of(map[row + x]), disparity_of(map[above + x])) {
        return;
    }
    // If the pixels on the left belong to the same runs and touch, the runs have been united there.
    if x > 0u && !begins(row, x) && !begins(above, x)
        && alike(disparity_of(map[row + x - 1u]), disparity_of(map[above + x - 1u])) {
        return;
    }
    unite(row + x, above + x);
}

@compute @workgroup_size(64)
fn count(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = id.x;
    if x >= scale.width {
        return;
    }
    let row = id.y * scale.width;
    if disparity_of(map[row + x]) == 0u || !begins(row, x) {
        return;
    }
    let root = root_of(row + x);
    if root != row + x {
        atomicAdd(&counts[root], atomicLoad(&counts[row + x]));
    }
}

// Unknown pixels get confidence 0.
@compute @workgroup_size(64)
fn remove(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = id.x;
    if x >= scale.width {
        return;
    }
    let at = id.y * scale.width + x;
    if disparity_of(map[at]) == 0u || atomicLoad(&counts[root_of(at)]) < scale.speckle_pixels {
        map[at] = 0u;
    }
}
