//! Prometheus' text format: base units, counters that end in `_total`.

use std::fmt::Write;

/// The format's name.
pub const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// What a metric is to Prometheus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// It only grows while the process lives.
    Counter,
    /// It goes up and down.
    Gauge,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Counter => "counter",
            Self::Gauge => "gauge",
        }
    }
}

/// The samples of one metric.
#[derive(Debug, Default)]
pub struct Samples(Vec<(String, f64)>);

impl Samples {
    /// The only sample.
    pub fn one(&mut self, value: f64) {
        self.0.push((String::new(), value));
    }

    /// A sample with labels.
    pub fn labelled(&mut self, labels: &[(&str, &str)], value: f64) {
        let escaped = |v: &str| v.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
        let list: Vec<String> = labels.iter().map(|(k, v)| format!("{k}=\"{}\"", escaped(v))).collect();
        self.0.push((format!("{{{}}}", list.join(",")), value));
    }

    /// One sample for each name: 1 for the one that holds, 0 for the others.
    pub fn one_of(&mut self, label: &str, names: &[&str], holds: usize) {
        for (i, name) in names.iter().enumerate() {
            self.labelled(&[(label, name)], f64::from(u8::from(i == holds)));
        }
    }
}

/// Writes a metric with its samples; nothing when it has none.
pub fn write(page: &mut String, name: &str, kind: Kind, help: &str, samples: &Samples) {
    if samples.0.is_empty() {
        return;
    }
    let _ = writeln!(page, "# HELP lookout_{name} {help}\n# TYPE lookout_{name} {}", kind.name());
    for (labels, value) in &samples.0 {
        let _ = writeln!(page, "lookout_{name}{labels} {value}");
    }
}
