//! The report of an evaluation of drives as one HTML page that needs no other file: table, time lines, and filmstrips of
//! what should not have happened.

use super::event::Event;
use super::filmstrip::Still;
use super::report::{DriveReport, FIGURES, RecordingReport};
use super::score::LEVELS;
use crate::reporting::html::{escaped, page};
use std::fmt::Write;

/// The events of one recording with their pictures, and its alarm over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Film {
    /// Time since the first frame in seconds, and level, of each frame.
    pub levels: Vec<(f64, String)>,
    /// Times of the frames with a false obstacle, in seconds since the first frame.
    pub false_s: Vec<f64>,
    /// Events with their pictures before, at and after; without pictures beyond a number of events.
    pub events: Vec<(Event, Vec<Still>)>,
}

const WIDTH: f64 = 1000.0;
const BAR: f64 = 26.0;
const TICKS: f64 = 14.0;
/// Colours of [`LEVELS`].
const COLOURS: [&str; 4] = ["#b9bdc4", "#7cc48d", "#f0a030", "#d03030"];
const FALSE: &str = "#b02ad0";

/// The page. `films` belong to the report's recordings.
pub fn to_html(report: &DriveReport, films: &[Film]) -> String {
    let mut body = String::from("<h1>Drives</h1>\n");
    body.push_str(
        "<p>Nothing was hit. So each warning and alarm is false, unless something crossed ahead and left in time, and so is \
         each confirmed obstacle that reaches into the strip that the vehicle then drove through, unless it moves along: what \
         drives ahead has left when the vehicle is there, and is not judged (moving).</p>\n",
    );
    table(&mut body, report);
    let films = films.iter().chain(std::iter::repeat(const { &Film::new() }));
    for (recording, film) in report.recordings.iter().zip(films) {
        section(&mut body, recording, film);
    }
    page("Drives", &body)
}

fn table(body: &mut String, report: &DriveReport) {
    let columns = report.columns();
    body.push_str("<table><tr><th>");
    for (name, _) in &columns {
        let _ = write!(body, "<th>{}", escaped(name));
    }
    body.push_str("</tr>\n");
    for (i, figure) in FIGURES.iter().enumerate() {
        let _ = write!(body, "<tr><td>{}", escaped(figure));
        for (_, values) in &columns {
            let _ = write!(body, "<td>{}", escaped(&values[i]));
        }
        body.push_str("</tr>\n");
    }
    body.push_str("</table>\n");
}

fn section(body: &mut String, recording: &RecordingReport, film: &Film) {
    let score = &recording.score;
    let _ =
        writeln!(body, "<h2>{}</h2>\n<p>Judged by {}.", escaped(&recording.name), escaped(&recording.truth));
    let _ = writeln!(
        body,
        " {} of {} confirmed tracks were lost in view; {} of {} boxes have no size.</p>",
        score.tracks_lost, score.tracks, score.without_size, score.boxes
    );
    if !score.off_reasons.is_empty() {
        body.push_str("<ul>\n");
        for (reason, frames) in &score.off_reasons {
            let _ = writeln!(body, "<li>alarm off in {frames} frames: {}</li>", escaped(reason));
        }
        body.push_str("</ul>\n");
    }
    timeline(body, film);
    for (event, stills) in &film.events {
        let _ = writeln!(
            body,
            "<h3>Frame {}: {}</h3>\n<p>{}</p>",
            event.frame,
            escaped(event.kind),
            escaped(&event.text)
        );
        if stills.is_empty() {
            continue;
        }
        body.push_str("<div class=\"strip\">\n");
        for still in stills {
            let _ = writeln!(
                body,
                "<figure><img src=\"{}\" alt=\"\"><figcaption>{}</figcaption></figure>",
                still.source,
                escaped(&still.caption)
            );
        }
        body.push_str("</div>\n");
    }
    if film.events.is_empty() {
        body.push_str("<p>No warning, no alarm, no false obstacle.</p>\n");
    }
}

/// The level of the alarm over time as a coloured bar, with a tick below for each frame with a false obstacle.
fn timeline(body: &mut String, film: &Film) {
    let (Some(first), Some(last)) = (film.levels.first(), film.levels.last()) else { return };
    let period_s = (last.0 - first.0) / (film.levels.len().max(2) - 1) as f64;
    let span_s = (last.0 - first.0 + period_s).max(1e-3);
    let x = |time_s: f64| WIDTH * (time_s - first.0) / span_s;
    let height = BAR + TICKS + 34.0;
    let _ = writeln!(
        body,
        "<svg viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" font-size=\"12\" role=\"img\" \
         aria-label=\"level of the alarm over time\">"
    );
    for run in film.levels.chunk_by(|a, b| a.1 == b.1) {
        let (Some(from), Some(to)) = (run.first(), run.last()) else { continue };
        let level = LEVELS.iter().position(|name| *name == from.1).unwrap_or(0);
        let _ = writeln!(
            body,
            "<rect x=\"{:.2}\" y=\"0\" width=\"{:.2}\" height=\"{BAR}\" fill=\"{}\"><title>{} {:.1} s</title></rect>",
            x(from.0),
            x(to.0 + period_s) - x(from.0),
            COLOURS[level],
            LEVELS[level],
            from.0
        );
    }
    for &time_s in &film.false_s {
        let at = x(time_s);
        let _ = writeln!(
            body,
            "<path d=\"M{at:.1} {:.0}V{:.0}\" stroke=\"{FALSE}\" stroke-width=\"2\"/>",
            BAR + 2.0,
            BAR + TICKS
        );
    }
    for part in 0..=5 {
        let time_s = first.0 + span_s * f64::from(part) / 5.0;
        let anchor = ["start", "middle", "middle", "middle", "middle", "end"][part as usize];
        let _ = writeln!(
            body,
            "<text x=\"{:.1}\" y=\"{:.0}\" text-anchor=\"{anchor}\">{time_s:.1} s</text>",
            x(time_s),
            BAR + TICKS + 14.0
        );
    }
    let names = LEVELS.iter().zip(COLOURS).chain([(&"false obstacle", FALSE)]);
    for (i, (name, colour)) in names.enumerate() {
        let _ = writeln!(
            body,
            "<text x=\"{}\" y=\"{:.0}\" fill=\"{colour}\" font-weight=\"bold\">{name}</text>",
            90 * i,
            height - 4.0
        );
    }
    body.push_str("</svg>\n");
}

impl Film {
    /// Without frames and events.
    pub const fn new() -> Self {
        Self { levels: Vec::new(), false_s: Vec::new(), events: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::score::DriveScore;
    use super::*;

    #[test]
    fn the_page_shows_time_line_events_and_pictures() {
        let levels = ["off", "off", "clear", "alarm", "clear"];
        let at = |(i, level): (usize, &&str)| (0.1 * i as f64, (*level).to_owned());
        let event = Event { frame: 3, kind: "alarm", text: "track 7 <near>".into() };
        let still = Still { caption: "frame 3, 0.3 s".into(), source: "data:image/jpeg;base64,AAAA".into() };
        let film = Film {
            levels: levels.iter().enumerate().map(at).collect(),
            false_s: vec![0.2, 0.3],
            events: vec![(event.clone(), vec![still.clone(), still.clone(), still])],
        };
        let mut report = DriveReport::default();
        report.recordings.push(RecordingReport {
            name: "a & b".into(),
            truth: "poses.txt".into(),
            score: DriveScore { frames: 5, ..DriveScore::default() },
            events: vec![event.clone()],
        });
        let html = to_html(&report, &[film]);
        for part in ["a &amp; b", "Judged by poses.txt", "Frame 3: alarm", "track 7 &lt;near&gt;"] {
            assert!(html.contains(part), "{part}: {html}");
        }
        assert_eq!((html.matches("<img src=\"data:").count(), html.matches("<rect").count()), (3, 4));
        assert!(html.contains("<tr><td>frames<td>5</tr>"), "{html}");
        assert!(FIGURES.iter().all(|figure| html.contains(figure)));
        // Two ticks below the bar; no file is needed.
        assert_eq!(html.matches("stroke=\"#b02ad0\"").count(), 2);
        assert!(!html.contains("http") && !html.contains("NaN"), "{html}");
        let svg = &html[html.find("<svg").unwrap()..html.find("</svg>").unwrap() + 6];
        roxmltree::Document::parse(svg).unwrap();
        // A recording without frames, and one without film.
        assert!(to_html(&report, &[Film::new()]).contains("No warning"));
        assert!(to_html(&report, &[]).contains("No warning"));
    }
}
