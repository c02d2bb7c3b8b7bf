//! The Prometheus text format. Metrics use base units; names of counters end in `_total`.

use std::fmt::Write;

/// Content type of the format.
pub const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Type of a metric.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Only increases while the process lives.
    Counter,
    /// Increases and decreases.
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
    /// Adds the only sample of a metric without labels.
    pub fn one(&mut self, value: f64) {
        self.0.push((String::new(), value));
    }

    /// Adds a sample with labels.
    pub fn labelled(&mut self, labels: &[(&str, &str)], value: f64) {
        let escaped = |v: &str| v.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
        let list: Vec<String> = labels.iter().map(|(k, v)| format!("{k}=\"{}\"", escaped(v))).collect();
        self.0.push((format!("{{{}}}", list.join(",")), value));
    }

    /// Adds one sample per name: 1 for the current one, 0 for the others (a state set).
    pub fn one_of(&mut self, label: &str, names: &[&str], current: usize) {
        for (i, name) in names.iter().enumerate() {
            self.labelled(&[(label, name)], f64::from(u8::from(i == current)));
        }
    }
}

/// Writes a metric with its samples; nothing if it has none.
pub fn write(page: &mut String, name: &str, kind: Kind, help: &str, samples: &Samples) {
    if samples.0.is_empty() {
        return;
    }
    let _ = writeln!(page, "# HELP lookout_{name} {help}\n# TYPE lookout_{name} {}", kind.name());
    for (labels, value) in &samples.0 {
        let _ = writeln!(page, "lookout_{name}{labels} {value}");
    }
}
