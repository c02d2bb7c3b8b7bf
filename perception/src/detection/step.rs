//! Steps in depth within one vertical run: a person who stands before a wall ends where the wall behind begins, though the matcher
//! smooths the step over some rows.

/// Fewest rows on each side of a step.
const MIN_ROWS: usize = 4;

/// Smallest step in px: the matcher's own steps and what windows and shadows do to one surface are smaller.
const MIN_STEP_PX: f64 = 0.5;

/// Smallest step in standard deviations of the frame's noise.
const MIN_STEP_SIGMAS: f64 = 2.0;

/// Smallest step in metres: from its bumper to the top of its windscreen a car has less.
const MIN_STEP_M: f64 = 2.5;

/// Least share of the variance that two constant disparities explain. Of a slope they explain 0.75.
const MIN_EXPLAINED: f64 = 0.85;

/// Where a run of disparities (1/256 px, from one end to the other) has a step: the number of rows before it. `distance_m` is the distance
/// of a disparity in px, `noise_px` the noise of the frame.
pub(super) fn find(
    rows: impl ExactSizeIterator<Item = u16> + Clone,
    noise_px: f64,
    distance_m: impl Fn(f64) -> f64,
) -> Option<usize> {
    let count = rows.len();
    if count < 2 * MIN_ROWS {
        return None;
    }
    let min_step_px = MIN_STEP_PX.max(MIN_STEP_SIGMAS * noise_px);
    let px = |row: u16| f64::from(row) / 256.0;
    let (sum, squares) =
        rows.clone().map(px).fold((0.0, 0.0), |(sum, squares), px| (sum + px, squares + px * px));
    let n = count as f64;
    let total = squares - sum * sum / n;
    // Below this no division into parts of [`MIN_ROWS`] reaches the smallest step.
    if total < 0.5 * min_step_px * min_step_px * MIN_ROWS as f64 {
        return None;
    }
    let mut before = 0.0;
    let mut best = (0.0, 0, [0.0; 2]);
    for (i, row) in rows.enumerate() {
        before += px(row);
        let [a, b] = [(i + 1) as f64, n - (i + 1) as f64];
        if i + 1 < MIN_ROWS || i + 1 + MIN_ROWS > count {
            continue;
        }
        let means = [before / a, (sum - before) / b];
        let between = a * b / n * (means[0] - means[1]).powi(2);
        if between > best.0 {
            best = (between, i + 1, means);
        }
    }
    let (between, at, means) = best;
    let is_step = between >= MIN_EXPLAINED * total
        && (means[0] - means[1]).abs() >= min_step_px
        && (distance_m(means[0]) - distance_m(means[1])).abs() >= MIN_STEP_M;
    is_step.then_some(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where a run of disparities in px has a step, with cameras that see 1 px at 150 m.
    fn step(rows: impl Iterator<Item = f64>) -> Option<usize> {
        step_in_noise(rows, 0.1)
    }

    fn step_in_noise(rows: impl Iterator<Item = f64>, noise_px: f64) -> Option<usize> {
        let rows: Vec<u16> = rows.map(|px| (256.0 * px) as u16).collect();
        find(rows.iter().copied(), noise_px, |px| 150.0 / px)
    }

    #[test]
    fn a_person_ends_where_the_wall_behind_begins() {
        let person = std::iter::repeat_n(6.5, 30);
        let blur = [6.3, 6.0, 5.7, 5.4];
        let wall = std::iter::repeat_n(5.3, 20);
        assert_eq!(step(person.clone().chain(blur).chain(wall)), Some(32));
        assert_eq!(step(person.clone().chain(std::iter::repeat_n(6.2, 20))), None, "a dent");
        assert_eq!(step(person.chain(std::iter::repeat_n(5.3, 3))), None, "too few rows");
    }

    #[test]
    fn a_step_counts_in_both_directions_and_is_larger_than_the_noise() {
        let low = || std::iter::repeat_n(5.3, 20);
        let high = || std::iter::repeat_n(6.5, 20);
        assert_eq!(step(low().chain(high())), Some(20));
        assert_eq!(step_in_noise(high().chain(low()), 0.55), Some(20));
        assert_eq!(step_in_noise(high().chain(low()), 0.65), None);
    }

    #[test]
    fn neither_a_slope_nor_a_bonnet_has_a_step() {
        assert_eq!(step((0..40).map(|i| 8.0 - 0.05 * f64::from(i))), None);
        // 15 m ahead, the bonnet 1.2 m long.
        let car =
            std::iter::repeat_n(10.0, 15).chain([9.8, 9.6, 9.4, 9.3]).chain(std::iter::repeat_n(9.2, 12));
        assert_eq!(step(car), None);
        assert_eq!(step(std::iter::repeat_n(9.0, 40)), None);
        assert_eq!(step(std::iter::empty()), None);
    }
}
