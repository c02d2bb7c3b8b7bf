// What every kernel knows of its scale. The same structure is written by `ScaleUniform`.
struct Scale {
    width: u32,
    height: u32,
    // Words of a row of a picture, four pixels each.
    stride: u32,
    disparities: u32,
    // Columns and rows of blocks.
    tiles: u32,
    strips: u32,
    // Zero, but no compiler knows it: see `opaque`.
    zero: u32,
    merging: u32,
    // The matching cost.
    bias: i32,
    gradient_limit: u32,
    scale_factor: f32,
    mean_factor: f32,
    // The next coarser scale, and what windows around its map may take.
    coarse_width: u32,
    coarse_height: u32,
    widest: u32,
    budget: u32,
    // The winner.
    sub_pixel: u32,
    left_right: u32,
    min_confidence: u32,
    // Islands and holes.
    speckle_pixels: u32,
    speckle_step: u32,
    bridge_px: u32,
    bridge_step: u32,
    // Below this confidence of the neighbourhood a pixel of the finest scale is unknown.
    min_trust: u32,
}

// Edge of a block in pixels.
const BLOCK = 32u;

// One block's search: disparities from `low` to one before `high`. Its nodes start at word `at` of a
// volume, pixel after pixel and row after row; a word holds four disparities, the first of which is a
// multiple of four.
struct Block {
    low: u32,
    high: u32,
    at: u32,
    spare: u32,
    slope_x: i32,
    slope_y: i32,
    spare_2: u32,
    spare_3: u32,
}

fn first_word(block: Block) -> u32 {
    return block.low / 4u;
}

fn end_word(block: Block) -> u32 {
    return (block.high + 3u) / 4u;
}

fn disparity_of(word: u32) -> u32 {
    return word & 0xffffu;
}

fn confidence_of(word: u32) -> u32 {
    return (word >> 16u) & 0xffu;
}

fn apart(a: u32, b: u32) -> u32 {
    return max(a, b) - min(a, b);
}
