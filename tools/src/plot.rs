//! Lines over frames: latency by stage.

use crate::picture::{Colour, Picture};

/// One line of a plot.
#[derive(Clone, Debug)]
pub struct Series {
    /// What it shows.
    pub name: String,
    /// (x, y), x rising.
    pub points: Vec<(f64, f64)>,
}

const COLOURS: [Colour; 6] =
    [[80, 160, 255], [255, 120, 60], [90, 210, 110], [220, 110, 240], [240, 240, 240], [250, 220, 80]];
const MARGIN: i32 = 50;

/// A step of 1, 2 or 5 times a power of ten that divides a range into about five.
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

/// Draws lines with axes that start at zero, `unit` on the upright one.
pub fn lines(title: &str, x_name: &str, unit: &str, series: &[Series]) -> Picture {
    let (width, height) = (900, 420);
    let mut picture = Picture::new(width as usize, height as usize, [24, 26, 30]);
    let points = || series.iter().flat_map(|s| &s.points).filter(|(x, y)| x.is_finite() && y.is_finite());
    let right = points().map(|p| p.0).fold(1.0, f64::max);
    let top = points().map(|p| p.1).fold(1e-3, f64::max) * 1.08;
    let place = |x: f64, y: f64| {
        let px = f64::from(MARGIN) + x / right * f64::from(width - MARGIN - 20);
        let py = f64::from(height - 40) - y / top * f64::from(height - 90);
        (px.round() as i32, py.round() as i32)
    };
    let grid = [58, 62, 70];
    let ink = [190, 195, 205];
    let y_step = step(top);
    let mut y = 0.0;
    while y <= top {
        picture.line(place(0.0, y), place(right, y), grid, 1);
        picture.text(&format!("{y:>6}"), 4, place(0.0, y).1 - 7, ink);
        y += y_step;
    }
    let x_step = step(right);
    let mut x = 0.0;
    while x <= right {
        let at = place(x, 0.0);
        picture.line(at, place(x, top), grid, 1);
        picture.text(&format!("{x}"), at.0 - 7, at.1 + 5, ink);
        x += x_step;
    }
    picture.text(&format!("{title} ({unit} over {x_name})"), MARGIN, 6, [240, 240, 240]);
    let mut legend = MARGIN;
    for (line, colour) in series.iter().zip(COLOURS.iter().cycle()) {
        for pair in line.points.windows(2) {
            if pair.iter().all(|(x, y)| x.is_finite() && y.is_finite()) {
                picture.line(place(pair[0].0, pair[0].1), place(pair[1].0, pair[1].1), *colour, 1);
            }
        }
        picture.text(&line.name, legend, 24, *colour);
        legend += 7 * line.name.chars().count() as i32 + 20;
    }
    picture
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
        // Nothing to show is no reason to panic.
        lines("empty", "frame", "ms", &[]);
    }
}
