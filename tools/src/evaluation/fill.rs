//! Hole filling for disparity maps.

/// Fills every unknown pixel (negative) with the smaller, i.e. farther, of the nearest known values to its left
/// and right in the row, or with the only one. Rows without any known value are filled in the same way from
/// above and below. A map without any known value becomes zero.
///
/// This is `interpolateBackground` of the KITTI stereo devkit, which evaluates only dense maps. The devkit
/// applies the second step only at the top and bottom of the image, the only place where it has an effect.
///
/// # Panics
/// When `disparity_px` does not have `width` × `height` values.
pub fn interpolate_background(disparity_px: &mut [f32], width: usize, height: usize) {
    assert_eq!(disparity_px.len(), width * height);
    for y in 0..height {
        fill_line(disparity_px, y * width, 1, width);
    }
    for x in 0..width {
        fill_line(disparity_px, x, width, height);
    }
    disparity_px.iter_mut().filter(|d| **d < 0.0).for_each(|d| *d = 0.0);
}

/// Fills the holes of the line `start`, `start + step`, … with `count` values.
fn fill_line(map: &mut [f32], start: usize, step: usize, count: usize) {
    let at = |i: usize| start + i * step;
    let mut before = None;
    let mut hole = 0; // start of the current hole
    for i in 0..=count {
        let here = (i < count).then(|| map[at(i)]);
        match here {
            Some(d) if d < 0.0 => continue,
            _ => {}
        }
        let value = match (before, here) {
            (Some(a), Some(b)) => Some(f32::min(a, b)),
            (a, b) => a.or(b),
        };
        if let Some(value) = value {
            (hole..i).for_each(|j| map[at(j)] = value);
        }
        before = here;
        hole = i + 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference implementation: the definition applied pixel by pixel.
    fn brute_force(map: &[f32], width: usize, height: usize) -> Vec<f32> {
        let nearest =
            |map: &[f32], places: &mut dyn Iterator<Item = usize>| places.map(|i| map[i]).find(|d| *d >= 0.0);
        let smaller = |a: Option<f32>, b: Option<f32>| match (a, b) {
            (Some(a), Some(b)) => a.min(b),
            (a, b) => a.or(b).unwrap_or(-1.0),
        };
        let step = |map: &[f32], by_row: bool| -> Vec<f32> {
            let value = |i: usize| {
                let (x, y) = (i % width, i / width);
                if map[i] >= 0.0 {
                    map[i]
                } else if by_row {
                    let left = nearest(map, &mut (0..x).rev().map(|x| y * width + x));
                    smaller(left, nearest(map, &mut (x + 1..width).map(|x| y * width + x)))
                } else {
                    let above = nearest(map, &mut (0..y).rev().map(|y| y * width + x));
                    smaller(above, nearest(map, &mut (y + 1..height).map(|y| y * width + x)))
                }
            };
            (0..map.len()).map(value).collect()
        };
        let filled = step(&step(map, true), false);
        filled.into_iter().map(|d| d.max(0.0)).collect()
    }

    #[test]
    fn holes_take_the_background_of_their_row_then_of_their_column() {
        let u = -1.0;
        let mut map = vec![u, 9.0, u, 4.0, u, u, u, u, u, u, 2.0, u, u, u, 3.0];
        interpolate_background(&mut map, 5, 3);
        assert_eq!(map, [9.0, 9.0, 4.0, 4.0, 4.0, 2.0, 2.0, 2.0, 2.0, 3.0, 2.0, 2.0, 2.0, 2.0, 3.0]);
        let mut map = vec![u; 6];
        interpolate_background(&mut map, 3, 2);
        assert_eq!(map, [0.0; 6]);
    }

    #[test]
    fn random_maps_are_filled_as_defined() {
        for seed in 0..60 {
            let mut random = fastrand::Rng::with_seed(seed);
            let (width, height) = (random.usize(1..13), random.usize(1..11));
            let density = random.f32() * random.f32();
            let value = |_| if random.f32() < density { random.u8(0..20).into() } else { -1.0 };
            let map: Vec<f32> = (0..width * height).map(value).collect();
            let mut filled = map.clone();
            interpolate_background(&mut filled, width, height);
            assert_eq!(filled, brute_force(&map, width, height), "seed {seed}, {width}x{height}: {map:?}");
        }
    }
}
