// Parameters of a scale for all kernels. Same layout as `ScaleUniform`.
struct Scale {
    width: u32,
    height: u32,
    // Words per image row; a word holds four pixels.
    stride: u32,
    disparities: u32,
    // Number of columns and rows of blocks.
    tiles: u32,
    strips: u32,
    // Zero at run time, unknown to the compiler: see `opaque`.
    zero: u32,
    merging: u32,
    // The matching cost.
    bias: i32,
    gradient_limit: u32,
    scale_factor: f32,
    mean_factor: f32,
    // Size of the next coarser scale, maximum window size, and budget of all windows.
    coarse_width: u32,
    coarse_height: u32,
    widest: u32,
    budget: u32,
    // Selection of the winner.
    sub_pixel: u32,
    left_right: u32,
    min_confidence: u32,
    // Speckle filter and hole interpolation.
    speckle_pixels: u32,
    speckle_step: u32,
    bridge_px: u32,
    bridge_step: u32,
    // Minimum confidence of the neighbourhood at the finest scale; below it a pixel is unknown.
    min_filtered_confidence: u32,
}

// Edge length of a block in pixels.
const BLOCK = 32u;

// The search window of one block: disparities `low` to `high` − 1. Its nodes start at word `at` of a volume, pixel
// by pixel and row by row. A word holds four disparities, the first of which is a multiple of four.
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
