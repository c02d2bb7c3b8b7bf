//! Every level agrees with the reference implementation, operation by operation.

use super::*;

/// Applies all operations of a level to given vectors and appends their results to `out`.
#[inline(always)]
fn operations<S: Simd>(s: S, a: &Lanes, b: &Lanes, block: &mut [Lanes], out: &mut Vec<Lanes>) {
    let (x, y) = (s.load(a), s.load(b));
    let results = [
        s.splat(a.0[0]),
        s.min(x, y),
        s.max(x, y),
        s.add(x, y),
        s.sub(x, y),
        s.mean(x, y),
        s.select_equal(x, y, x, s.splat(9)),
        s.select_less(x, y, x, y),
        s.select_less(x, y, y, x),
        s.shift_right(x, y),
        s.shift_left(x, y),
        s.contains(a, y),
    ];
    for result in results {
        let mut lanes = Lanes::ZERO;
        s.store(result, &mut lanes);
        out.push(lanes);
    }
    s.transpose(block, block.len() / LANES);
}

kernel! { fn run(a: &Lanes, b: &Lanes, block: &mut [Lanes], out: &mut Vec<Lanes>) = operations }

#[test]
fn levels_agree_operation_by_operation() {
    let mut random = fastrand::Rng::with_seed(2);
    let mut lanes = || Lanes(std::array::from_fn(|_| random.u8(..)));
    for round in 0..100 {
        let (a, mut b) = (lanes(), lanes());
        b.0[..5].copy_from_slice(&a.0[..5]);
        let stride = round % 3 + 1;
        let block: Vec<Lanes> = (0..LANES * stride).map(|_| lanes()).collect();
        let results = |level| {
            let (mut block, mut out) = (block.clone(), Vec::new());
            run(level, &a, &b, &mut block, &mut out);
            (block, out)
        };
        let plain = results(Level::PLAIN);
        for level in Level::available() {
            assert!(results(level) == plain, "{} differs from plain", level.name());
        }
        for i in 0..LANES {
            for j in 0..LANES {
                assert_eq!(plain.0[i * stride].0[j], block[j * stride].0[i]);
            }
        }
    }
}

/// Remaps one tile.
#[inline(always)]
fn remap_tile<S: Simd>(s: S, source: &[u8], stride: usize, tile: &RemapTile, out: &mut Lanes) {
    s.remap(source, stride, tile, out);
}

kernel! { fn remap(source: &[u8], stride: usize, tile: &RemapTile, out: &mut Lanes) = remap_tile }

#[test]
fn a_remapped_window_is_never_loaded_from_outside_the_image() {
    let mut tile = RemapTile::BLACK;
    tile.windows = [[0, 0], [8, 1], [0, 0], [4, 0]];
    // Three rows of the lowest window, to the byte.
    let bytes = (1 + 2) * 40 + 8 + 16;
    assert_eq!(tile.window_starts(bytes, 40), Some([0, 48, 0, 4]));
    assert_eq!(tile.window_starts(bytes - 1, 40), None);
    // Strides whose products overflow: wrapped round, they would lie in the image.
    tile.windows = [[16, 2]; 4];
    for stride in [usize::MAX / 2 + 1, usize::MAX, usize::MAX - 8, 1 << (usize::BITS - 1)] {
        assert_eq!(tile.window_starts(1 << 20, stride), None, "{stride}");
        for level in Level::available() {
            let mut out = Lanes::FULL;
            // All pixels are black, so that no level needs the image.
            remap(level, &[7; 64], stride, &tile, &mut out);
            assert_eq!(out, Lanes::ZERO, "{}", level.name());
        }
    }
}

/// Streams a vector to every place of `out`.
#[inline(always)]
fn stream_all<S: Simd>(s: S, value: u8, out: &mut [Lanes]) {
    let streaming = Streaming::new(s);
    out.iter_mut().for_each(|lanes| streaming.store(s.splat(value), lanes));
}

kernel! { fn stream(value: u8, out: &mut [Lanes]) = stream_all }

#[test]
fn streamed_vectors_are_there_after_the_fence_for_every_thread() {
    for level in Level::available() {
        let mut vectors = vec![Lanes::ZERO; 4096];
        for value in 1..20 {
            stream(level, value, &mut vectors);
            let is_there = || vectors.iter().all(|lanes| *lanes == Lanes::splat(value));
            assert!(std::thread::scope(|scope| scope.spawn(is_there).join().unwrap()), "{}", level.name());
        }
    }
}

#[test]
fn levels_have_names_and_the_best_is_available() {
    let levels = Level::available();
    assert_eq!(levels[0], Level::PLAIN);
    assert!(levels.contains(&Level::best()));
    let names: Vec<_> = levels.iter().map(|l| l.name()).collect();
    println!("levels here: {names:?}");
    assert!(levels.iter().all(|&level| Level::named(level.name()) == Some(level)));
    assert_eq!(Level::named("mmx"), None);
}
