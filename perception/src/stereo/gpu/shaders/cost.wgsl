// The matching cost of four disparities along the columns of a block: the sum over a window is that of its five
// columns, and each column is used by five windows.

@group(0) @binding(0) var<uniform> scale: Scale;
@group(0) @binding(1) var<storage, read> features: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> blocks: array<Block>;
@group(0) @binding(3) var<storage, read_write> costs: array<u32>;

// Optimisation barrier: the compiler cannot fuse or reorder operations across it.
fn opaque(value: vec4<f32>) -> vec4<f32> {
    return bitcast<vec4<f32>>(bitcast<vec4<u32>>(value) ^ vec4<u32>(scale.zero));
}

fn feature(picture: u32, x: i32, y: u32) -> vec4<u32> {
    let column = u32(clamp(x, -2, i32(scale.width) + 1) + 2);
    return features[(picture * scale.height + y) * (scale.width + 4u) + column];
}

// Products of a column of the left window with those of four right windows, with 128 subtracted from each pixel.
fn products(left: vec4<u32>, right: array<vec2<u32>, 4>) -> vec4<i32> {
    let fifth = left.y & 0xffu;
    let offset = 128 * i32(dot4U8Packed(left.x, 0x01010101u) + fifth);
    return vec4<i32>(
        i32(dot4U8Packed(left.x, right[0].x) + fifth * (right[0].y & 0xffu)),
        i32(dot4U8Packed(left.x, right[1].x) + fifth * (right[1].y & 0xffu)),
        i32(dot4U8Packed(left.x, right[2].x) + fifth * (right[2].y & 0xffu)),
        i32(dot4U8Packed(left.x, right[3].x) + fifth * (right[3].y & 0xffu)),
    ) - vec4<i32>(offset);
}

@compute @workgroup_size(64)
fn score(@builtin(global_invocation_id) at: vec3<u32>) {
    let index = at.y;
    let block = blocks[index];
    let first = first_word(block);
    let words = end_word(block) - first;
    if at.x >= BLOCK * words {
        return;
    }
    let row = at.x / words;
    let word = at.x % words;
    let y = index / scale.tiles * BLOCK + row;
    if y >= scale.height {
        return;
    }
    let start = i32(index % scale.tiles * BLOCK);
    let end = min(start + i32(BLOCK), i32(scale.width));
    // Offset to the right image's column of the first of the four disparities.
    let shift = i32(4u * (first + word));

    // Columns x, x − 1, x − 2 and x − 3 of the right image.
    var column: array<vec2<u32>, 4>;
    for (var i = 0; i < 3; i++) {
        column[i] = feature(1u, start - 3 - i - shift, y).xy;
    }
    // Sums of the window's columns except the last.
    var sums: array<vec4<i32>, 4>;
    for (var i = 0; i < 4; i++) {
        let x = start - 2 + i;
        column[3] = column[2];
        column[2] = column[1];
        column[1] = column[0];
        column[0] = feature(1u, x - shift, y).xy;
        sums[i] = products(feature(0u, x, y), column);
    }
    var gradient = vec4<u32>(0u);
    var gain = vec4<f32>(0.0);
    var mean = vec4<f32>(0.0);
    for (var i = 2; i >= 0; i--) {
        let right = feature(1u, start - 1 - i - shift, y);
        gradient = vec4<u32>(right.y >> 8u, gradient.xyz);
        gain = vec4<f32>(bitcast<f32>(right.z), gain.xyz);
        mean = vec4<f32>(bitcast<f32>(right.w), mean.xyz);
    }
    var out = block.at + row * BLOCK * words + word;
    for (var x = start; x < end; x++) {
        column[3] = column[2];
        column[2] = column[1];
        column[1] = column[0];
        column[0] = feature(1u, x + 2 - shift, y).xy;
        let last = products(feature(0u, x + 2, y), column);
        let sum = sums[0] + sums[1] + sums[2] + sums[3] + last;
        sums[0] = sums[1];
        sums[1] = sums[2];
        sums[2] = sums[3];
        sums[3] = last;

        let right = feature(1u, x - shift, y);
        gradient = vec4<u32>(right.y >> 8u, gradient.xyz);
        gain = vec4<f32>(bitcast<f32>(right.z), gain.xyz);
        mean = vec4<f32>(bitcast<f32>(right.w), mean.xyz);
        let left = feature(0u, x, y);
        let scaled = opaque(vec4<f32>(sum + vec4<i32>(scale.bias)) * bitcast<f32>(left.z));
        let product = opaque(scaled * gain);
        let means = opaque(bitcast<f32>(left.w) * mean);
        let similarity = opaque(product - means);
        let structure = vec4<u32>(vec4<i32>(38.5 - similarity)) & vec4<u32>(0xffu);
        let here = vec4<u32>(left.y >> 8u);
        let step = min(max(here, gradient) - min(here, gradient), vec4<u32>(scale.gradient_limit));
        let cost = min(structure + min(2u * step, vec4<u32>(255u)), vec4<u32>(255u));
        costs[out] = pack4xU8(cost);
        out += words;
    }
}
