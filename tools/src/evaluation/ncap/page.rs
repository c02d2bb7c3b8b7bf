//! The result of the standard tests as one HTML page that needs no other file: a coloured table by row and speed, near
//! misses, and filmstrips of runs that failed.

use super::report::{Line, NOT_JUDGED, NcapReport, Setup, seconds};
use crate::reporting::html::{escaped, page};
use std::fmt::Write;

/// A picture of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Still {
    /// What it shows.
    pub caption: String,
    /// The picture as the `src` of an HTML page.
    pub source: String,
}

/// Colours: all passed, some, none, not judged.
const COLOURS: [&str; 4] = ["#bfe5c7", "#fbe3b0", "#f3b7b7", "#e3e5e8"];

fn colour(line: &Line) -> &'static str {
    match (line.passed, line.judged) {
        (_, 0) => COLOURS[3],
        (passed, judged) if passed == judged => COLOURS[0],
        (0, _) => COLOURS[2],
        _ => COLOURS[1],
    }
}

/// The page. `films` has the pictures of runs by their place in the report's list.
pub fn to_html(report: &NcapReport, films: &[(usize, Vec<Still>)]) -> String {
    let Setup { year, rig, fps, seeds: (from, to) } = &report.setup;
    let title = format!("Standard tests {year}, rig {rig}");
    let mut body = format!("<h1>{}</h1>\n", escaped(&title));
    let _ =
        writeln!(body, "<p>{fps} pairs/s, seeds {from} to {to}.</p>\n<pre>{}</pre>", escaped(&report.rules));
    body.push_str("<h2>Impacts</h2>\n<ul>\n");
    for sum in &report.sums {
        let _ = writeln!(body, "<li>passed, {}</li>", escaped(&sum.to_string()));
    }
    body.push_str("</ul>\n<p>In each cell: runs that passed of those that are judged; median TTC of warning and alarm in seconds; speed at the worst impact in km/h.</p>\n");
    grid(&mut body, &report.table, |line| {
        format!(
            "{}<br>{} / {} s<br>{:.0} km/h",
            if line.judged > 0 {
                format!("<b>{}/{}</b>", line.passed, line.judged)
            } else {
                "not judged".into()
            },
            seconds(line.warning_ttc_s),
            seconds(line.alarm_ttc_s),
            line.impact_km_h
        )
    });
    body.push_str("<h2>Near misses</h2>\n<ul>\n");
    for sum in &report.near_miss_sums {
        let _ = writeln!(body, "<li>silent, {}</li>", escaped(&sum.to_string()));
    }
    body.push_str("</ul>\n");
    grid(&mut body, &report.near_misses, |line| format!("<b>{}/{}</b>", line.passed, line.judged));
    let failed: Vec<usize> =
        (0..report.runs.len()).filter(|&k| report.runs[k].verdict.passed == Some(false)).collect();
    if !failed.is_empty() {
        body.push_str("<h2>Runs that failed</h2>\n");
    }
    for k in failed {
        let _ = writeln!(body, "<p>{}</p>", escaped(&report.runs[k].explanation()));
        let Some((_, stills)) = films.iter().find(|(run, _)| *run == k) else { continue };
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
    let not_judged = report.not_judged();
    if !not_judged.is_empty() {
        let _ = writeln!(
            body,
            "<h2>Not judged</h2>\n<p>{}: {}.</p>",
            NOT_JUDGED,
            escaped(&not_judged.join("; "))
        );
    }
    page(&title, &body)
}

/// Lines as a table: a row for each row, near miss and weather, a column for each speed.
fn grid(body: &mut String, lines: &[Line], cell: impl Fn(&Line) -> String) {
    let mut speeds: Vec<f64> = lines.iter().map(|line| line.own_km_h).collect();
    speeds.sort_by(f64::total_cmp);
    speeds.dedup();
    body.push_str("<table><tr><th>row<th>weather<th>rules");
    for speed in &speeds {
        let _ = write!(body, "<th>{speed} km/h");
    }
    body.push_str("</tr>\n");
    let key = |line: &Line| (line.row.clone(), line.miss.clone(), line.weather.clone());
    let mut done = Vec::new();
    for first in lines {
        if done.contains(&key(first)) {
            continue;
        }
        done.push(key(first));
        let own = || lines.iter().filter(|line| key(line) == key(first));
        let mut rules: Vec<&str> = own().flat_map(|line| &line.rules).map(String::as_str).collect();
        rules.sort_unstable();
        rules.dedup();
        let what = first.miss.as_ref().map_or(first.title.clone(), |miss| format!("{}: {miss}", first.title));
        let _ = write!(
            body,
            "<tr><td><b>{}</b><br>{}<td>{}<td>{}",
            escaped(&first.row),
            escaped(&what),
            first.weather,
            rules.join("<br>")
        );
        for speed in &speeds {
            match own().find(|line| line.own_km_h == *speed) {
                Some(line) => {
                    let _ = write!(body, "<td style=\"background:{}\">{}", colour(line), cell(line));
                }
                None => body.push_str("<td>"),
            }
        }
        body.push_str("</tr>\n");
    }
    body.push_str("</table>\n");
}

#[cfg(test)]
mod tests {
    use super::super::report::tests::report;
    use super::*;

    #[test]
    fn the_page_has_colours_reasons_and_pictures() {
        let still = Still {
            caption: "TTC 1.10 s: warning <late>".into(),
            source: "data:image/jpeg;base64,AA".into(),
        };
        let html = to_html(&report(), &[(3, vec![still.clone(), still])]);
        let count = |part: &str| html.matches(part).count();
        // One cell each: all passed; some of the impacts and of the near misses; not judged.
        assert_eq!(COLOURS.map(count), [1, 2, 0, 1], "{html}");
        assert_eq!(count("<img src=\"data:"), 2);
        assert!(html.contains("warning late &lt;1.7 s") && html.contains("warning &lt;late&gt;"), "{html}");
        assert!(html.contains("not judged") && html.contains("w1.7+avoid") && html.contains("<th>30 km/h"));
        assert!(!html.contains("http") && !html.contains("NaN"));
    }
}
