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

#[test]
fn levels_have_names_and_the_best_is_available() {
    let levels = Level::available();
    assert_eq!(levels[0], Level::PLAIN);
    assert!(levels.contains(&Level::best()));
    let names: Vec<_> = levels.iter().map(|l| l.name()).collect();
    println!("levels here: {names:?}");
}
