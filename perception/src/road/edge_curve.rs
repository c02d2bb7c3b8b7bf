//! Curvature of the road ahead from its edges.
//!
//! Input: the edges of one frame ([`super::edges`]). Output: the curvature of the parabola that all of them share, with its
//! standard deviation: both sides run parallel, x = a(side) + b z − κ z²/2.

use nalgebra::{SMatrix, SVector};

/// Fewest edges, and smallest extent of them along the road in metres: with less, noise is a bend.
const MIN_EDGES: usize = 6;
const MIN_SPAN_M: f64 = 8.0;
/// Fewest edges of a side that tell a curvature and their agreement with it; and how many standard deviations both sides
/// may differ by.
const MIN_SIDE_EDGES: usize = 4;
const AGREEMENT_SIGMAS: f64 = 3.0;
/// An edge this far from the others, in metres, is none of the road: a driveway, a parked car.
const MAX_RESIDUAL_M: f64 = 0.35;
/// Standard deviation of an edge across, in metres: half a cell.
const SIGMA_M: f64 = 0.1;
/// A road that runs at a larger angle to the vehicle is not the one that it follows, as slope.
const MAX_SLOPE: f64 = 0.2;

/// An edge of the road: side (0 left, 1 right), lateral position and distance in metres.
pub type EdgePlace = (usize, f64, f64);

/// Curvature of the road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeCurve {
    /// Curvature, in 1/m, to the left positive.
    pub curvature_per_m: f64,
    /// Its standard deviation, in 1/m.
    pub sigma_per_m: f64,
}

/// The curve of these edges; `None` if they do not tell.
pub fn edge_curve(edges: impl Iterator<Item = EdgePlace> + Clone) -> Option<EdgeCurve> {
    let (first, _) = fit(edges.clone())?;
    let is_near = |&(side, lateral_m, distance_m): &EdgePlace| {
        (row(side, distance_m).dot(&first) - lateral_m).abs() <= MAX_RESIDUAL_M
    };
    let kept = edges.filter(is_near);
    let span = kept.clone().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), e| (l.min(e.2), m.max(e.2)));
    if kept.clone().count() < MIN_EDGES || span.1 - span.0 < MIN_SPAN_M {
        return None;
    }
    if !sides_agree(&kept) {
        return None;
    }
    let (solution, inverse) = fit(kept)?;
    let sigma_per_m = SIGMA_M * inverse[(3, 3)].max(0.0).sqrt();
    let is_ahead = solution[2].abs() <= MAX_SLOPE && solution[3].is_finite();
    is_ahead.then_some(EdgeCurve { curvature_per_m: solution[3], sigma_per_m })
}

/// Whether both sides are seen, and bend alike when each is fitted alone: a row of parked cars, or a driveway, bends one.
fn sides_agree(edges: &(impl Iterator<Item = EdgePlace> + Clone)) -> bool {
    let alone = |side: usize| {
        let own = edges.clone().filter(move |edge| edge.0 == side);
        let (solution, inverse) = (own.clone().count() >= MIN_SIDE_EDGES).then(|| fit(own)).flatten()?;
        Some((solution[3], inverse[(3, 3)].max(0.0)))
    };
    alone(0).zip(alone(1)).is_some_and(|((left, a), (right, b))| {
        (left - right).abs() <= AGREEMENT_SIGMAS * SIGMA_M * (a + b).sqrt()
    })
}

/// Derivatives of an edge's lateral position by the unknowns: offsets left and right, slope, curvature.
fn row(side: usize, distance_m: f64) -> SVector<f64, 4> {
    let [left, right] = [side == 0, side != 0].map(|is| f64::from(u8::from(is)));
    SVector::<f64, 4>::new(left, right, distance_m, -distance_m * distance_m / 2.0)
}

/// Least squares: solution, and inverse of the normal matrix.
fn fit(edges: impl Iterator<Item = EdgePlace>) -> Option<(SVector<f64, 4>, SMatrix<f64, 4, 4>)> {
    let mut normal = SMatrix::<f64, 4, 4>::zeros();
    let mut right = SVector::<f64, 4>::zeros();
    let mut sides = [false; 2];
    for (side, lateral_m, distance_m) in edges {
        let row = row(side, distance_m);
        normal += row * row.transpose();
        right += row * lateral_m;
        sides[usize::from(side != 0)] = true;
    }
    // The offset of a side that is not seen is 0.
    for (i, seen) in sides.iter().enumerate() {
        normal[(i, i)] += f64::from(u8::from(!seen));
    }
    let inverse = normal.try_inverse()?;
    Some((inverse * right, inverse))
}

#[cfg(test)]
mod tests {
    use super::*;

    const DISTANCES_M: [f64; 8] = [5.75, 7.25, 9.0, 11.0, 13.0, 15.0, 17.0, 19.25];

    fn edges(curvature: f64, sides: &[(usize, f64)], random: &mut fastrand::Rng) -> Vec<EdgePlace> {
        let mut all = Vec::new();
        for &(side, offset_m) in sides {
            for z in DISTANCES_M {
                let noise = 0.2 * (random.f64() - 0.5) + 0.1 * (random.f64() - 0.5);
                all.push((side, offset_m + 0.02 * z - curvature * z * z / 2.0 + noise, z));
            }
        }
        all
    }

    #[test]
    fn the_curvature_of_both_edges_is_found_with_its_error() {
        let mut random = fastrand::Rng::with_seed(4);
        for sides in [&[(0, -2.5), (1, 4.0)][..], &[(0, -4.0), (1, 3.0)]] {
            for truth in [-0.02, 0.0, 0.0167] {
                for _ in 0..20 {
                    let all = edges(truth, sides, &mut random);
                    let found = edge_curve(all.into_iter()).unwrap();
                    let error = (found.curvature_per_m - truth).abs();
                    assert!(
                        error < 4.0 * found.sigma_per_m && found.sigma_per_m < 0.006,
                        "{found:?} {truth}"
                    );
                }
            }
        }
    }

    #[test]
    fn one_side_alone_and_sides_that_bend_differently_tell_nothing() {
        let mut random = fastrand::Rng::with_seed(5);
        for side in [(0, -2.5), (1, 3.0)] {
            assert_eq!(edge_curve(edges(0.01, &[side], &mut random).into_iter()), None);
        }
        let mut both = edges(0.0, &[(0, -2.5)], &mut random);
        both.extend(edges(0.03, &[(1, 3.0)], &mut random));
        assert_eq!(edge_curve(both.into_iter()), None);
    }

    #[test]
    fn few_edges_and_crossing_roads_tell_nothing() {
        let mut random = fastrand::Rng::with_seed(4);
        let all = edges(0.01, &[(0, -2.0)], &mut random);
        assert_eq!(edge_curve(all[..5].iter().copied()), None);
        assert_eq!(edge_curve([].into_iter()), None);
        let crossing = all.iter().map(|&(side, lateral, z)| (side, lateral + 0.5 * z, z));
        assert_eq!(edge_curve(crossing), None);
        // A parked car in one segment changes little.
        let mut parked = edges(0.01, &[(0, -2.0), (1, 3.0)], &mut random);
        parked[12].1 -= 1.2;
        let found = edge_curve(parked.into_iter()).unwrap();
        assert!((found.curvature_per_m - 0.01).abs() < 0.004, "{found:?}");
    }
}
