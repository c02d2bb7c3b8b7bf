//! Vector plots (SVG): lines or dots with axes and round tick values.

use std::fmt::Write;

/// One data series.
#[derive(Clone, Debug)]
pub struct Series {
    /// Label in the legend.
    pub name: String,
    /// (x, y); values that are not finite are skipped.
    pub points: Vec<(f64, f64)>,
    /// Draw dots instead of a line.
    pub dots: bool,
}

/// A plot.
#[derive(Clone, Debug, Default)]
pub struct Plot {
    /// Title above the plot.
    pub title: String,
    /// Label of the x axis, with unit.
    pub x_name: String,
    /// Label of the y axis, with unit.
    pub y_name: String,
    /// Data series.
    pub series: Vec<Series>,
    /// A horizontal line with its label, such as a budget.
    pub limit: Option<(String, f64)>,
    /// Ticks of the x axis; round numbers if empty.
    pub x_marks: Vec<(f64, String)>,
    /// Draw a map: the same scale on both axes, which do not start at zero.
    pub is_map: bool,
}

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 420.0;
const LEFT: f64 = 78.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 58.0;
const BOTTOM: f64 = 52.0;
const COLOURS: [&str; 6] = ["#1f6fc5", "#d1540f", "#1d8a3c", "#9133b5", "#5d6570", "#b08900"];

/// A tick step of 1, 2 or 5 times a power of ten that divides a range into about five parts.
fn step(range: f64) -> f64 {
    let rough = (range / 5.0).max(1e-12);
    let power = 10_f64.powf(rough.log10().floor());
    let factor = match rough / power {
        r if r <= 1.0 => 1.0,
        r if r <= 2.0 => 2.0,
        r if r <= 5.0 => 5.0,
        _ => 10.0,
    };
    factor * power
}

/// A number with as many decimals as its tick step needs.
fn number(value: f64, step: f64) -> String {
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.decimals$}")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Maps data values to positions in the drawing.
struct Axes {
    left: f64,
    right: f64,
    bottom: f64,
    top: f64,
}

impl Axes {
    fn x(&self, v: f64) -> f64 {
        LEFT + (v - self.left) / (self.right - self.left) * (WIDTH - LEFT - RIGHT)
    }

    fn y(&self, v: f64) -> f64 {
        HEIGHT - BOTTOM - (v - self.bottom) / (self.top - self.bottom) * (HEIGHT - TOP - BOTTOM)
    }
}

/// Axes of a map: as many metres to a pixel on both, the drawing in their middle.
fn map_axes(left: f64, right: f64, ys: impl Iterator<Item = f64>) -> Axes {
    let (low, high) = ys.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(y), h.max(y)));
    let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
    let (width, height) = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
    let scale = (1.1 * (right - left) / width).max(1.1 * (high - low) / height).max(1e-9);
    let (across, up) = (0.5 * scale * width, 0.5 * scale * height);
    let (x, y) = (0.5 * (left + right), 0.5 * (low + high));
    Axes { left: x - across, right: x + across, bottom: y - up, top: y + up }
}

impl Plot {
    /// The SVG document. The y axis starts at zero, or at the smallest value below it.
    pub fn to_svg(&self) -> String {
        let finite = |s: &Series| -> Vec<(f64, f64)> {
            s.points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect()
        };
        let series: Vec<Vec<(f64, f64)>> = self.series.iter().map(finite).collect();
        let axes = self.axes(&series);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n\
             <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#ffffff\"/>\n\
             <text x=\"{LEFT}\" y=\"20\" font-size=\"15\">{}</text>\n",
            escape(&self.title)
        );
        self.write_grid(&mut out, &axes);
        self.write_limit(&mut out, &axes);
        self.write_series(&mut out, &axes, &series);
        out.push_str("</svg>\n");
        out
    }

    fn axes(&self, series: &[Vec<(f64, f64)>]) -> Axes {
        let all = || series.iter().flatten();
        let left = all().map(|p| p.0).fold(f64::INFINITY, f64::min);
        let right = all().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
        let (left, right) = if left < right { (left, right) } else { (0.0, 1.0) };
        let limit = self.limit.as_ref().map_or(0.0, |(_, y)| *y);
        if self.is_map {
            return map_axes(left, right, all().map(|p| p.1));
        }
        let top = all().map(|p| p.1).fold(limit.max(1e-9), f64::max) * 1.08;
        let bottom = all().map(|p| p.1).fold(0.0, f64::min) * 1.08;
        Axes { left, right, bottom, top }
    }

    /// Grid lines with their tick labels, and the names of both axes.
    fn write_grid(&self, out: &mut String, axes: &Axes) {
        let (floor, ceiling) = (axes.y(axes.bottom), axes.y(axes.top));
        let y_step = step(axes.top - axes.bottom);
        for i in (axes.bottom / y_step).ceil() as i64..=(axes.top / y_step).floor() as i64 {
            let value = i as f64 * y_step;
            let at = axes.y(value);
            let _ = writeln!(
                out,
                "<path d=\"M{LEFT} {at:.1}H{:.1}\" stroke=\"#dddddd\"/><text x=\"{:.1}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{}</text>",
                WIDTH - RIGHT,
                LEFT - 6.0,
                at + 4.0,
                number(value, y_step)
            );
        }
        let mut marks = self.x_marks.clone();
        if marks.is_empty() {
            let x_step = step(axes.right - axes.left);
            let (first, last) = ((axes.left / x_step).ceil() as i64, (axes.right / x_step).floor() as i64);
            marks = (first..=last)
                .map(|i| i as f64 * x_step)
                .map(|value| (value, number(value, x_step)))
                .collect();
        }
        for (value, name) in marks.iter().filter(|(value, _)| (axes.left..=axes.right).contains(value)) {
            let at = axes.x(*value);
            let _ = writeln!(
                out,
                "<path d=\"M{at:.1} {floor:.1}V{ceiling:.1}\" stroke=\"#dddddd\"/><text x=\"{at:.1}\" y=\"{:.1}\" \
                 text-anchor=\"middle\">{}</text>",
                floor + 16.0,
                escape(name)
            );
        }
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\n\
             <text transform=\"translate(16 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            (LEFT + WIDTH - RIGHT) / 2.0,
            HEIGHT - 12.0,
            escape(&self.x_name),
            (floor + ceiling) / 2.0,
            escape(&self.y_name)
        );
    }

    fn write_limit(&self, out: &mut String, axes: &Axes) {
        let Some((name, value)) = &self.limit else { return };
        let at = axes.y(*value);
        let _ = writeln!(
            out,
            "<path d=\"M{LEFT} {at:.1}H{:.1}\" stroke=\"#c00000\" stroke-dasharray=\"6 4\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#c00000\">{}</text>",
            WIDTH - RIGHT,
            WIDTH - RIGHT - 4.0,
            at - 5.0,
            escape(name)
        );
    }

    /// The data, and the legend below the title.
    fn write_series(&self, out: &mut String, axes: &Axes, series: &[Vec<(f64, f64)>]) {
        let mut legend = LEFT;
        for ((points, s), colour) in series.iter().zip(&self.series).zip(COLOURS.iter().cycle()) {
            if s.dots {
                for &(px, py) in points {
                    let _ = writeln!(
                        out,
                        "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2\" fill=\"{colour}\"/>",
                        axes.x(px),
                        axes.y(py)
                    );
                }
            } else if !points.is_empty() {
                let path: Vec<String> =
                    points.iter().map(|&(px, py)| format!("{:.1} {:.1}", axes.x(px), axes.y(py))).collect();
                let _ = writeln!(
                    out,
                    "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>",
                    path.join("L")
                );
            }
            let _ = writeln!(
                out,
                "<text x=\"{legend:.1}\" y=\"42\" fill=\"{colour}\">{}</text>",
                escape(&s.name)
            );
            legend += 7.0 * s.name.chars().count() as f64 + 24.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plot_shows_its_lines_its_dots_and_its_limit() {
        let plot = Plot {
            title: "a < b & c".into(),
            x_name: "s".into(),
            y_name: "ms".into(),
            series: vec![
                Series {
                    name: "line".into(),
                    points: vec![(0.0, 1.0), (5.0, f64::NAN), (10.0, 2.0)],
                    dots: false,
                },
                Series { name: "dots".into(), points: vec![(2.0, 1.5), (3.0, 0.5)], dots: true },
            ],
            limit: Some(("budget 4 ms".into(), 4.0)),
            x_marks: Vec::new(),
            is_map: false,
        };
        let svg = plot.to_svg();
        assert!(svg.contains("a &lt; b &amp; c") && svg.contains("budget 4 ms"), "{svg}");
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        // The limit is inside the drawing, above all points.
        let from = |text: &str| svg[svg.find(text).unwrap()..].to_owned();
        let limit = from("stroke=\"#c00000\"");
        assert!(limit.contains("budget"));
        let document = roxmltree::Document::parse(&svg).unwrap();
        assert_eq!(document.root_element().tag_name().name(), "svg");
        // Values below zero are inside; a map has one scale for both axes.
        let points = vec![(0.0, -4.0), (10.0, 4.0)];
        let mut plot =
            Plot { series: vec![Series { name: "a".into(), points, dots: false }], ..Plot::default() };
        let axes = |plot: &Plot| plot.axes(&[plot.series[0].points.clone()]);
        assert!(axes(&plot).y(-4.0) < HEIGHT - BOTTOM && axes(&plot).y(-4.0) > axes(&plot).y(0.0));
        plot.is_map = true;
        let map = axes(&plot);
        assert!((map.x(10.0) - map.x(0.0) - 10.0 / 8.0 * (map.y(-4.0) - map.y(4.0))).abs() < 1e-6);
        assert!(map.x(0.0) > LEFT && map.y(4.0) > TOP);
        roxmltree::Document::parse(&plot.to_svg()).unwrap();
        // Empty data do not panic.
        roxmltree::Document::parse(&Plot::default().to_svg()).unwrap();
    }
}
