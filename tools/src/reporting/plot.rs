//! Bitmap plots with axes: line plots and bar charts.

use crate::reporting::picture::{Colour, Picture};
use crate::reporting::record::tidy;

/// One data series of a plot.
#[derive(Clone, Debug)]
pub struct Series {
    /// Label in the legend.
    pub name: String,
    /// (x, y) with increasing x.
    pub points: Vec<(f64, f64)>,
}

const COLOURS: [Colour; 6] =
    [[80, 160, 255], [255, 120, 60], [90, 210, 110], [220, 110, 240], [240, 240, 240], [250, 220, 80]];
const MARGIN: i32 = 50;

/// A tick step of 1, 2 or 5 times a power of ten that divides a range into about five parts.
fn step(range: f64) -> f64 {
    let rough = (range / 5.0).max(1e-9);
    let power = 10_f64.powf(rough.log10().floor());
    let factor = match rough / power {
        r if r <= 1.0 => 1.0,
        r if r <= 2.0 => 2.0,
        r if r <= 5.0 => 5.0,
        _ => 10.0,
    };
    factor * power
}

/// An empty plot and its coordinate transform.
struct Axes {
    picture: Picture,
    left: f64,
    right: f64,
    top: f64,
    /// Whether x is logarithmic.
    is_log: bool,
}

const GRID: Colour = [58, 62, 70];
const FAINT_GRID: Colour = [40, 43, 49];
const INK: Colour = [190, 195, 205];

impl Axes {
    /// Axes from `left` to `right` and from 0 to slightly above `top`, with grid lines.
    fn new(title: &str, (left, right): (f64, f64), top: f64) -> Self {
        let picture = Picture::new(900, 420, [24, 26, 30]);
        let mut axes = Self { picture, left, right, top: top * 1.08, is_log: false };
        axes.rows();
        let x_step = step(right - left);
        let (first, last) = ((left / x_step).ceil() as i32, (right / x_step).floor() as i32);
        for i in first..=last {
            let x = f64::from(i) * x_step;
            let (from, to) = (axes.place(x, 0.0), axes.place(x, axes.top));
            axes.picture.line(from, to, GRID, 1);
            axes.picture.text(&format!("{}", tidy(x)), from.0 - 7, from.1 + 5, INK);
        }
        axes.picture.text(title, MARGIN, 6, [240, 240, 240]);
        axes
    }

    /// The same with a logarithmic x axis, whose ends are powers of ten.
    fn logarithmic(title: &str, (left, right): (f64, f64), top: f64) -> Self {
        let picture = Picture::new(900, 420, [24, 26, 30]);
        let mut axes = Self { picture, left, right, top: top * 1.08, is_log: true };
        axes.rows();
        let (first, last) = (left.log10().round() as i32, right.log10().round() as i32);
        for power in first..=last {
            for factor in 1..10 {
                let x = f64::from(factor) * 10_f64.powi(power);
                if x > right * 1.001 {
                    break;
                }
                let (from, to) = (axes.place(x, 0.0), axes.place(x, axes.top));
                // Lines within a decade are fainter.
                axes.picture.line(from, to, if factor == 1 { GRID } else { FAINT_GRID }, 1);
                if factor == 1 {
                    axes.picture.text(&format!("{}", tidy(x)), from.0 - 7, from.1 + 5, INK);
                }
            }
        }
        axes.picture.text(title, MARGIN, 6, [240, 240, 240]);
        axes
    }

    /// The grid lines of the y axis.
    fn rows(&mut self) {
        let y_step = step(self.top);
        for i in 0..=(self.top / y_step) as u32 {
            let y = f64::from(i) * y_step;
            let (from, to) = (self.place(self.left, y), self.place(self.right, y));
            self.picture.line(from, to, GRID, 1);
            self.picture.text(&format!("{:>6}", tidy(y)), 4, from.1 - 7, INK);
        }
    }

    fn place(&self, x: f64, y: f64) -> (i32, i32) {
        let (width, height) = (self.picture.width() as i32, self.picture.height() as i32);
        let share = if self.is_log {
            (x.max(self.left) / self.left).log10() / (self.right / self.left).log10()
        } else {
            (x - self.left) / (self.right - self.left)
        };
        let px = f64::from(MARGIN) + share * f64::from(width - MARGIN - 20);
        let py = f64::from(height - 40) - y / self.top * f64::from(height - 90);
        (px.round() as i32, py.round() as i32)
    }

    /// Adds the legend.
    fn legend(mut self, series: &[Series]) -> Picture {
        let mut x = MARGIN;
        for (line, colour) in series.iter().zip(COLOURS.iter().cycle()) {
            self.picture.text(&line.name, x, 24, *colour);
            x += 7 * line.name.chars().count() as i32 + 20;
        }
        self.picture
    }
}

fn finite(series: &[Series]) -> impl Iterator<Item = &(f64, f64)> {
    series.iter().flat_map(|s| &s.points).filter(|(x, y)| x.is_finite() && y.is_finite())
}

/// Draws a line plot with axes from zero; `unit` labels the y axis.
pub fn lines(title: &str, x_name: &str, unit: &str, series: &[Series]) -> Picture {
    let right = finite(series).map(|p| p.0).fold(1.0, f64::max);
    let top = finite(series).map(|p| p.1).fold(1e-3, f64::max);
    let axes = Axes::new(&format!("{title} ({unit} over {x_name})"), (0.0, right), top);
    draw_lines(axes, series)
}

/// The same with a logarithmic x axis from `left`, a power of ten; smaller values are drawn there.
pub fn lines_over_log(title: &str, x_name: &str, unit: &str, left: f64, series: &[Series]) -> Picture {
    let most = finite(series).map(|p| p.0).fold(10.0 * left, f64::max);
    let right = 10_f64.powf((most.log10() - 1e-9).ceil());
    let top = finite(series).map(|p| p.1).fold(1e-3, f64::max);
    let title = format!("{title} ({unit} over {x_name}, logarithmic)");
    draw_lines(Axes::logarithmic(&title, (left, right), top), series)
}

fn draw_lines(mut axes: Axes, series: &[Series]) -> Picture {
    for (line, colour) in series.iter().zip(COLOURS.iter().cycle()) {
        for pair in line.points.windows(2) {
            if pair.iter().all(|(x, y)| x.is_finite() && y.is_finite()) {
                let (from, to) = (axes.place(pair[0].0, pair[0].1), axes.place(pair[1].0, pair[1].1));
                axes.picture.line(from, to, *colour, 1);
            }
        }
    }
    axes.legend(series)
}

/// Draws a bar chart; the bars of all series are grouped around their x. `unit` labels the y axis. All series
/// have the same equidistant x.
pub fn bars(title: &str, x_name: &str, unit: &str, series: &[Series]) -> Picture {
    let low = finite(series).map(|p| p.0).fold(f64::INFINITY, f64::min);
    let high = finite(series).map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
    let (low, high) = if low <= high { (low, high) } else { (0.0, 0.0) };
    let count = series.iter().map(|s| s.points.len()).max().unwrap_or(0).max(2);
    let space = if high > low { (high - low) / (count - 1) as f64 } else { 1.0 };
    let top = finite(series).map(|p| p.1).fold(1e-3, f64::max);
    let ends = (low - 0.6 * space, high + 0.6 * space);
    let mut axes = Axes::new(&format!("{title} ({unit} over {x_name})"), ends, top);
    let strength = 0.8 * space / series.len().max(1) as f64;
    for (i, (bars, colour)) in series.iter().zip(COLOURS.iter().cycle()).enumerate() {
        for &(x, y) in bars.points.iter().filter(|(x, y)| x.is_finite() && y.is_finite()) {
            let start = x - 0.4 * space + i as f64 * strength;
            let (from, to) = (axes.place(start, y.max(0.0)), axes.place(start + strength, 0.0));
            axes.picture.fill([from.0, from.1, to.0 - from.0 - 1, to.1 - from.1], *colour);
        }
    }
    axes.legend(series)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_numbers() {
        assert_eq!(step(10.0), 2.0);
        assert_eq!(step(0.9), 0.2);
        assert_eq!(step(480.0), 100.0);
    }

    #[test]
    fn a_line_is_drawn_from_left_to_right_and_gaps_do_no_harm() {
        let points = vec![(0.0, 5.0), (50.0, f64::NAN), (60.0, 5.0), (100.0, 5.0)];
        let picture = lines("test", "frame", "ms", &[Series { name: "a".into(), points }]);
        let coloured = |x: usize| (0..picture.height()).any(|y| picture.at(x, y) == COLOURS[0]);
        assert!(coloured(700) && coloured(800));
        // Empty data do not panic.
        lines("empty", "frame", "ms", &[]);
    }

    #[test]
    fn decades_are_equally_wide_on_a_logarithmic_axis() {
        let points = vec![(0.0, 1.0), (0.01, 1.0), (100.0, 1.0)];
        let series = [Series { name: "a".into(), points }];
        let picture = lines_over_log("roc", "%", "%", 0.01, &series);
        let axes = Axes::logarithmic("", (0.01, 100.0), 1.0);
        let x: Vec<i32> = [0.01, 0.1, 1.0, 10.0, 100.0].map(|x| axes.place(x, 0.0).0).into();
        assert!(x.windows(2).all(|pair| (pair[1] - pair[0] - (x[1] - x[0])).abs() <= 1), "{x:?}");
        let coloured = |x: i32| (60..picture.height()).any(|y| picture.at(x as usize, y) == COLOURS[0]);
        assert!(coloured(x[0] + 2) && coloured(x[4] - 2), "{x:?}");
    }

    #[test]
    fn bars_stand_side_by_side() {
        let series = |name: &str, height: f64| Series {
            name: name.into(),
            points: (-2..=2).map(|x| (f64::from(x) / 4.0, height)).collect(),
        };
        let picture = bars("test", "px", "%", &[series("a", 10.0), series("b", 5.0)]);
        let count =
            |colour: Colour, y: usize| (0..picture.width()).filter(|&x| picture.at(x, y) == colour).count();
        // Near the bottom both colours have the same width; near the top only the tall bars remain.
        assert!(count(COLOURS[0], 370) > 200 && count(COLOURS[1], 370) > 200);
        assert!(count(COLOURS[0], 120) > 200 && count(COLOURS[1], 120) == 0);
        bars("empty", "px", "%", &[]);
        bars("one", "px", "%", &[Series { name: "a".into(), points: vec![(3.0, f64::NAN)] }]);
    }
}
