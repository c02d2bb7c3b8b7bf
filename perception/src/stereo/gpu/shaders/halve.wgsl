// Downsamples a pair by two: each pixel is the rounded mean of 2 × 2 pixels. For odd sizes the last column and row
// are replicated. `scale` is the coarser scale.

struct Fine {
    width: u32,
    height: u32,
    stride: u32,
    spare: u32,
}

@group(0) @binding(0) var<uniform> scale: Scale;
@group(0) @binding(1) var<storage, read> fine_pictures: array<u32>;
@group(0) @binding(2) var<storage, read_write> halved: array<u32>;
@group(0) @binding(3) var<uniform> fine: Fine;

fn fine_grey(picture: u32, x: u32, y: u32) -> u32 {
    let row = (picture * fine.height + min(y, fine.height - 1u)) * fine.stride;
    let column = min(x, fine.width - 1u);
    return (fine_pictures[row + column / 4u] >> (8u * (column % 4u))) & 0xffu;
}

@compute @workgroup_size(64)
fn halve(@builtin(global_invocation_id) at: vec3<u32>) {
    let word = at.x;
    let y = at.y;
    let picture = at.z;
    if word >= scale.stride {
        return;
    }
    var four = 0u;
    for (var i = 0u; i < 4u; i++) {
        let x = 2u * (4u * word + i);
        let sum = fine_grey(picture, x, 2u * y) + fine_grey(picture, x + 1u, 2u * y)
            + fine_grey(picture, x, 2u * y + 1u) + fine_grey(picture, x + 1u, 2u * y + 1u);
        four |= ((sum + 2u) / 4u) << (8u * i);
    }
    halved[(picture * scale.height + y) * scale.stride + word] = four;
}
