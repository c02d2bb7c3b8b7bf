// Features for the matching cost of each pixel of both images, with two border columns on either side: five rows of
// the window's column, the gradient, the scale of the covariance and the mean.

@group(0) @binding(0) var<uniform> scale: Scale;
@group(0) @binding(1) var<storage, read> pictures: array<u32>;
// Rows y − 2 to y + 1; row y + 2 and the gradient; scale; mean.
@group(0) @binding(2) var<storage, read_write> features: array<vec4<u32>>;

fn grey(picture: u32, x: i32, y: i32) -> u32 {
    let column = u32(clamp(x, 0, i32(scale.width) - 1));
    let row = picture * scale.height + u32(clamp(y, 0, i32(scale.height) - 1));
    return (pictures[row * scale.stride + column / 4u] >> (8u * (column % 4u))) & 0xffu;
}

// Optimisation barrier: the compiler cannot fuse or reorder operations across it.
fn opaque(value: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(value) ^ scale.zero);
}

fn power_of_two(exponent: i32) -> f32 {
    return bitcast<f32>(u32(exponent + 127) << 23u);
}

// 1 / √value, with both root and quotient rounded to the nearest float. Computed digit by digit, because a GPU's
// own square root and division may be off by a few units in the last place.
fn inverse_root(value: u32) -> f32 {
    // value = mantissa · 2^exponent with 24 bits, rounded like the conversion to a float.
    let top = 31u - countLeadingZeros(value);
    var mantissa = value;
    var exponent = i32(top) - 23;
    if top <= 23u {
        mantissa = value << (23u - top);
    } else {
        let shift = top - 23u;
        let rest = value & ((1u << shift) - 1u);
        let half = 1u << (shift - 1u);
        mantissa = value >> shift;
        if rest > half || (rest == half && (mantissa & 1u) == 1u) {
            mantissa += 1u;
        }
        if mantissa == 0x1000000u {
            mantissa = 0x800000u;
            exponent += 1;
        }
    }
    // √(mantissa · 2^shift) has 24 bits; the remaining exponent must be even.
    let shift = select(24, 23, (exponent & 1) != 0);
    var remainder = 0u;
    var root = 0u;
    for (var i = 0; i < 24; i++) {
        let place = 46 - 2 * i - shift;
        var pair = 0u;
        if place >= 0 {
            pair = (mantissa >> u32(place)) & 3u;
        } else if place == -1 {
            pair = (mantissa << 1u) & 3u;
        }
        remainder = (remainder << 2u) | pair;
        let trial = (root << 2u) | 1u;
        root <<= 1u;
        if remainder >= trial {
            remainder -= trial;
            root |= 1u;
        }
    }
    if remainder > root {
        root += 1u;
    }
    var root_exponent = (exponent - shift) / 2;
    if root == 0x1000000u {
        root = 0x800000u;
        root_exponent += 1;
    }
    // 2^47 / root, 24 bits.
    var quotient = 0u;
    var rest = 0x800000u;
    if root == 0x800000u {
        quotient = 0x1000000u;
    } else {
        for (var i = 0; i < 24; i++) {
            rest <<= 1u;
            quotient <<= 1u;
            if rest >= root {
                rest -= root;
                quotient |= 1u;
            }
        }
        if 2u * rest > root {
            quotient += 1u;
        }
    }
    return f32(quotient) * power_of_two(-47 - root_exponent);
}

@compute @workgroup_size(64)
fn prepare(@builtin(global_invocation_id) at: vec3<u32>) {
    let columns = scale.width + 4u;
    if at.x >= columns {
        return;
    }
    let picture = at.z;
    let x = i32(at.x) - 2;
    let y = i32(at.y);
    var total = 0u;
    var squares = 0u;
    for (var dy = -2; dy <= 2; dy++) {
        for (var dx = -2; dx <= 2; dx++) {
            let v = grey(picture, x + dx, y + dy);
            total += v;
            squares += v * v;
        }
    }
    // N²·variance + N²·C, exact.
    let spread = 25u * squares - total * total + 25u * u32(scale.bias);
    let norm = opaque(inverse_root(spread));
    let offset = 25 * 128 * i32(picture);
    let factor = opaque(norm * scale.mean_factor);
    let mean = f32(i32(total) - offset) * factor;
    let step = i32(grey(picture, x + 1, y - 1)) - i32(grey(picture, x - 1, y - 1))
        + 2 * (i32(grey(picture, x + 1, y)) - i32(grey(picture, x - 1, y)))
        + i32(grey(picture, x + 1, y + 1)) - i32(grey(picture, x - 1, y + 1));
    let gradient = u32(clamp(step / 4 + 128, 0, 255));
    let four = grey(picture, x, y - 2) | (grey(picture, x, y - 1) << 8u)
        | (grey(picture, x, y) << 16u) | (grey(picture, x, y + 1) << 24u);
    let fifth = grey(picture, x, y + 2) | (gradient << 8u);
    features[(picture * scale.height + at.y) * columns + at.x] =
        vec4<u32>(four, fifth, bitcast<u32>(norm * scale.scale_factor), bitcast<u32>(mean));
}
