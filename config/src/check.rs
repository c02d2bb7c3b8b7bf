//! Parses and checks a configuration. All errors are reported at once, each with its line, key and remedy.

mod detectors;
mod layers;
mod syntax;

use crate::automatic::AUTO;
use crate::keys::{self, Key, Kind};
use crate::limits::{MAX_BYTES, MAX_ERRORS, MAX_PATH_BYTES, MAX_SUGGESTED_CHARS};
use crate::paths;
use crate::profile::{PROFILES, profile_names};
use crate::tables::Config;
use layers::layered;
use perception::excerpt::{REASON_CHARS, VALUE_CHARS, excerpt};
use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use syntax::syntax_error;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue};

/// One error in a configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// The file, or the name of a profile.
    pub file: PathBuf,
    /// Its line, from 1; `None` if the file itself cannot be read.
    pub line: Option<usize>,
    /// What is wrong and what to do.
    pub text: String,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        write!(f, ": {}", self.text)
    }
}

/// All errors in a configuration, in the order of their lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigErrors(pub Vec<ConfigError>);

impl ConfigErrors {
    /// The same for settings that stand in no file.
    #[must_use]
    pub fn without_lines(mut self) -> Self {
        self.0.iter_mut().for_each(|error| error.line = None);
        self
    }
}

impl fmt::Display for ConfigErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, error) in self.0.iter().enumerate() {
            write!(f, "{}{error}", if i > 0 { "\n" } else { "" })?;
        }
        Ok(())
    }
}

impl std::error::Error for ConfigErrors {}

/// Loads the configuration that `-c` names: a file, or a built-in profile. `None` is `replay`.
///
/// # Errors
/// All errors in the file, each with its line.
pub fn load(name: Option<&Path>) -> Result<Config, ConfigErrors> {
    let Some(path) = name else { return parse("", Path::new("replay")) };
    if let Some((_, text)) = PROFILES.iter().find(|(profile, _)| path == Path::new(profile)) {
        return parse(text, path);
    }
    let alone = |text| ConfigErrors(vec![ConfigError { file: path.to_owned(), line: None, text }]);
    match read(path) {
        Ok((text, size)) if size <= MAX_BYTES => {
            let mut config = parse(&text, path)?;
            paths::resolve(&mut config, path);
            Ok(config)
        }
        Ok((_, size)) => Err(alone(too_large(size))),
        Err(error) if error.kind() == std::io::ErrorKind::InvalidData => {
            Err(alone("not a text: give a TOML file, such as lookout init writes".into()))
        }
        Err(error) => {
            let names: Vec<&str> = profile_names().collect();
            Err(alone(format!("{error}; give a file, or one of the profiles {}", names.join(", "))))
        }
    }
}

/// The text of a file and its size; of a file that is too large only the size. One that does not say its size is read to
/// the limit.
fn read(path: &Path) -> std::io::Result<(String, u64)> {
    let file = File::open(path)?;
    let size = file.metadata()?.len();
    let mut text = String::new();
    if size > MAX_BYTES {
        return Ok((text, size));
    }
    let read = file.take(MAX_BYTES + 1).read_to_string(&mut text)?;
    Ok((text, read as u64))
}

fn too_large(bytes: u64) -> String {
    format!(
        "{bytes} bytes: a configuration has at most {MAX_BYTES}; give a TOML file with the keys of \
         docs/configuration.md"
    )
}

/// Parses the text of a configuration; `file` is named in errors.
///
/// # Errors
/// All errors in the text, each with its line.
pub fn parse(text: &str, file: &Path) -> Result<Config, ConfigErrors> {
    let mut checker = Checker { text, file, errors: Vec::new(), more: 0 };
    if text.len() as u64 > MAX_BYTES {
        checker.add(None, too_large(text.len() as u64));
        return Err(checker.finish());
    }
    let table = match DeTable::parse(text) {
        Ok(table) => table,
        Err(error) => {
            let offset = error.span().map(|s| s.start);
            let text = syntax_error(text, offset, &excerpt(error.message(), REASON_CHARS));
            checker.add(offset, text);
            return Err(checker.finish());
        }
    };
    let base = checker.profile(table.get_ref());
    checker.table(table.get_ref());
    if !checker.errors.is_empty() {
        return Err(checker.finish());
    }
    let config = match layered(&[base, text]) {
        Ok(config) => config,
        Err(message) => {
            checker.add(None, excerpt(&message, REASON_CHARS).into_owned());
            return Err(checker.finish());
        }
    };
    checker.relations(&config, table.get_ref());
    if checker.errors.is_empty() { Ok(config) } else { Err(checker.finish()) }
}

/// Keys that no longer exist: table, key and what to do instead.
const REMOVED: &[(&str, &str, &str)] = &[
    ("regions", "confirm", "remove it; tracking.confirm_probability says what counts as an obstacle"),
    ("tracking", "confirm_frames", "set tracking.confirm_probability (default 0.9) instead"),
    ("tracking", "forget_frames", "set tracking.unseen_max_s, in seconds, instead"),
];

struct Checker<'a> {
    text: &'a str,
    file: &'a Path,
    errors: Vec<ConfigError>,
    /// Errors beyond [`MAX_ERRORS`], which are only counted.
    more: usize,
}

impl Checker<'_> {
    /// The errors in the order of their lines.
    fn finish(mut self) -> ConfigErrors {
        self.errors.sort_by_key(|error| error.line);
        if self.more > 0 {
            let text = format!("{} more errors: mend these {MAX_ERRORS} first", self.more);
            self.errors.push(ConfigError { file: self.file.to_owned(), line: None, text });
        }
        ConfigErrors(self.errors)
    }

    /// Whether one more error is only counted.
    fn is_full(&mut self) -> bool {
        let is_full = self.errors.len() >= MAX_ERRORS;
        self.more += usize::from(is_full);
        is_full
    }

    fn add(&mut self, offset: Option<usize>, text: String) {
        if self.is_full() {
            return;
        }
        let line = offset.map(|at| self.text[..at.min(self.text.len())].matches('\n').count() + 1);
        self.errors.push(ConfigError { file: self.file.to_owned(), line, text });
    }

    /// The text of the profile that `profile = "…"` names, or of the default profile.
    fn profile(&mut self, table: &DeTable<'_>) -> &'static str {
        let Some(value) = table.get("profile") else { return PROFILES[0].1 };
        let named = value.get_ref().as_str().and_then(|n| PROFILES.iter().find(|(name, _)| *name == n));
        if let Some((_, text)) = named {
            return text;
        }
        let names: Vec<&str> = profile_names().collect();
        self.add(Some(value.span().start), format!("profile: give one of \"{}\"", names.join("\", \"")));
        PROFILES[0].1
    }

    fn table(&mut self, root: &DeTable<'_>) {
        for (name, value) in root {
            if name.get_ref() == "profile" {
                continue;
            }
            let Some(table) = keys::tables().iter().find(|table| table.name == name.get_ref()) else {
                self.unknown(name, "table [", "]", || keys::tables().iter().map(|table| table.name));
                continue;
            };
            let Some(keys) = value.get_ref().as_table() else {
                self.add(Some(value.span().start), format!("{} is a table: write [{0}]", name.get_ref()));
                continue;
            };
            for (key_name, value) in keys {
                if let Some(key) = table.keys.iter().find(|key| key.name == key_name.get_ref().as_ref()) {
                    self.value(key, value);
                } else if let Some((.., remedy)) = REMOVED
                    .iter()
                    .find(|(of, name, _)| *of == table.name && *name == key_name.get_ref().as_ref())
                {
                    let text =
                        format!("key {}.{} is no longer used: {remedy}", table.name, key_name.get_ref());
                    self.add(Some(key_name.span().start), text);
                } else {
                    let before = format!("key {}.", table.name);
                    self.unknown(key_name, &before, "", || table.keys.iter().map(|key| &key.name[..]));
                }
            }
        }
    }

    /// Reports an unknown name between `before` and `after`, with the nearest known one.
    fn unknown<'k, I: Iterator<Item = &'k str>>(
        &mut self,
        name: &Spanned<DeString<'_>>,
        before: &str,
        after: &str,
        known: impl Fn() -> I,
    ) {
        // What is only counted costs no search.
        if self.is_full() {
            return;
        }
        let table = before.strip_prefix("key ").unwrap_or("");
        let hint = nearest(table, name.get_ref(), known());
        let shown = excerpt(name.get_ref(), VALUE_CHARS);
        self.add(Some(name.span().start), format!("unknown {before}{shown}{after}{hint}"));
    }

    fn value(&mut self, key: &Key, value: &Spanned<DeValue<'_>>) {
        let shown = excerpt(&self.text[value.span()], VALUE_CHARS).into_owned();
        let whole = || {
            let integer = value.get_ref().as_integer()?;
            i64::from_str_radix(integer.as_str(), integer.radix()).ok()
        };
        let number = || match value.get_ref().as_float() {
            Some(float) => float.as_str().parse::<f64>().ok(),
            None => whole().map(|v| v as f64),
        };
        let fits = match key.kind {
            Kind::Switch => value.get_ref().as_bool().is_some(),
            Kind::Automatic => value.get_ref().as_bool().is_some() || value.get_ref().as_str() == Some(AUTO),
            Kind::Whole(low, high) => whole().is_some_and(|v| (low..=high).contains(&v)),
            Kind::Number(low, high) => number().is_some_and(|v| (low..=high).contains(&v)),
            Kind::Choice(words) => match whole() {
                // A number without quotes means the same.
                Some(number) => words.contains(&&number.to_string()[..]),
                None => value.get_ref().as_str().is_some_and(|v| words.contains(&v)),
            },
            Kind::Name(most) => value.get_ref().as_str().is_some_and(|v| {
                (1..=most).contains(&v.len())
                    && v.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_')
            }),
            Kind::Path => {
                value.get_ref().as_str().is_some_and(|v| v.len() <= MAX_PATH_BYTES && !v.contains('\0'))
            }
            Kind::Detectors(most) => return self.detectors(key, most, value),
            Kind::Text(most) => {
                value.get_ref().as_str().is_some_and(|v| v.len() <= most && !v.contains(char::is_control))
            }
        };
        if !fits {
            let remedy = key.kind.to_string();
            self.add(Some(value.span().start), format!("{} = {shown}: give {remedy}", key.path()));
        }
    }

    /// Checks that involve several keys.
    fn relations(&mut self, c: &Config, root: &DeTable<'_>) {
        let place = |name: &str| {
            let (table, key) = name.split_once('.')?;
            Some(root.get(table)?.get_ref().as_table()?.get(key)?.span().start)
        };
        let mut ordered = |low: (&str, f64), high: (&str, f64)| {
            if low.1 > high.1 {
                let offset = place(low.0).or_else(|| place(high.0));
                let text =
                    format!("{} = {} is too high: at most {}, because of {}", low.0, low.1, high.1, high.0);
                self.add(offset, text);
            }
        };
        ordered(
            ("road.camera_height_min_m", c.road.camera_height_min_m),
            ("road.camera_height_max_m", c.road.camera_height_max_m),
        );
        ordered(
            ("regions.height_min_m", c.regions.height_min_m),
            ("regions.height_max_m", c.regions.height_max_m),
        );
        ordered(
            ("recognition.window_min_px", c.recognition.window_min_px as f64),
            ("recognition.window_max_px", c.recognition.window_max_px as f64),
        );
        ordered(
            ("supervision.restart_first_ms", c.supervision.restart_first_ms as f64),
            ("supervision.restart_longest_ms", c.supervision.restart_longest_ms as f64),
        );
        ordered(("pacing.min_fps", c.pacing.min_fps), ("pacing.max_fps", c.pacing.max_fps));
        let heartbeat = ("supervision.heartbeat_ms", c.supervision.heartbeat_ms as f64);
        ordered(
            heartbeat,
            ("supervision.liveness_deadline_ms", c.supervision.liveness_deadline_ms as f64 / 2.0),
        );
        // An idle stage notices a stop request at its next heartbeat at the latest.
        ordered(heartbeat, ("supervision.stop_grace_ms", c.supervision.stop_grace_ms as f64 / 2.0));
        // A hanging GPU must be detected before the stage counts as hanging, with time left for the CPU to match
        // the frame.
        if may_use_gpu(&c.stereo.backend, cfg!(feature = "gpu")) {
            ordered(
                ("stereo.gpu_timeout_ms", c.stereo.gpu_timeout_ms),
                (
                    "supervision.liveness_deadline_ms: half of it",
                    c.supervision.liveness_deadline_ms as f64 / 2.0,
                ),
            );
        }
        ordered(
            ("alarm.distance_m", c.alarm.distance_m),
            match c.regions.distance_max_m {
                // The least that a rig has.
                0.0 => ("regions.distance_max_m = 0: a rig's range may be as short", 60.0),
                range => ("regions.distance_max_m", range),
            },
        );
        ordered(("camera.skew_ms", c.camera.skew_ms), ("camera.fps: half of a period", 500.0 / c.camera.fps));
        ordered(
            ("camera.retry_first_ms", c.camera.retry_first_ms as f64),
            ("camera.retry_longest_ms", c.camera.retry_longest_ms as f64),
        );
        // 0 disables a rule.
        if c.alarm.ttc_alarm_s > 0.0 && c.alarm.ttc_warning_s > 0.0 {
            ordered(
                ("alarm.ttc_alarm_s", c.alarm.ttc_alarm_s),
                ("alarm.ttc_warning_s", c.alarm.ttc_warning_s),
            );
        }
        if c.alarm.deceleration_alarm_m_s2 > 0.0 {
            ordered(
                ("alarm.deceleration_warning_m_s2", c.alarm.deceleration_warning_m_s2),
                ("alarm.deceleration_alarm_m_s2", c.alarm.deceleration_alarm_m_s2),
            );
        }
        // Each step of load shedding begins at or above the temperature of the step before.
        let h = &c.heat;
        for pair in [
            ("heat.frame_rate_above_c", h.frame_rate_above_c),
            ("heat.clocks_above_c", h.clocks_above_c),
            ("heat.recognition_above_c", h.recognition_above_c),
            ("heat.stop_above_c", h.stop_above_c),
            ("heat.power_off_above_c", h.power_off_above_c),
        ]
        .windows(2)
        {
            ordered(pair[0], pair[1]);
        }
        ordered(("heat.start_below_c", h.start_below_c), ("heat.stop_above_c", h.stop_above_c));
        if c.board.power_off == "command" && c.board.power_off_command.as_os_str().is_empty() {
            let text = "board.power_off = \"command\": name the program with board.power_off_command";
            self.add(place("board.power_off"), text.into());
        }
        self.detector_sizes(c, place("recognition.detectors"));
        if c.source.fps > 0.0 && c.source.fps < 0.01 {
            let text = format!("source.fps = {}: give 0, or at least 0.01", c.source.fps);
            self.add(place("source.fps"), text);
        }
    }
}

/// Whether a matcher on the GPU may run: `auto` uses one only where the build has it.
fn may_use_gpu(backend: &str, is_built: bool) -> bool {
    backend == "gpu" || (backend == "auto" && is_built)
}

/// "; did you mean X?" for the known name with the smallest edit distance, with `table.` before a key.
fn nearest<'a>(table: &str, name: &str, mut known: impl Iterator<Item = &'a str>) -> String {
    // The distance to a name that is longer than all others says nothing.
    let known = known.by_ref().filter(|_| name.chars().nth(MAX_SUGGESTED_CHARS).is_none());
    match known.map(|k| (strsim::levenshtein(name, k), k)).min() {
        Some((d, word)) if d <= word.len().div_ceil(2) => format!("; did you mean {table}{word}?"),
        _ => "; docs/configuration.md lists all keys".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(text: &str) -> Vec<String> {
        parse(text, Path::new("car.toml")).unwrap_err().0.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn defaults_pass_every_check_and_come_back() {
        let config = Config::default();
        assert_eq!(load(None).unwrap(), config);
        let text = toml::to_string(&config).unwrap();
        assert_eq!(parse(&text, Path::new("defaults")).unwrap(), config);
        // Each key stands where its declaration says, with the default that it says, and there are no others.
        let written: toml::Table = text.parse().unwrap();
        for key in keys::all() {
            assert_eq!(written[key.table].get(&key.name), Some(&key.default), "{}", key.path());
        }
        let count: usize = written.values().map(|table| table.as_table().unwrap().len()).sum();
        assert_eq!(count, keys::all().count());
    }

    #[test]
    fn all_profiles_are_valid() {
        for name in profile_names() {
            load(Some(Path::new(name))).unwrap_or_else(|e| panic!("{e}"));
        }
        let tk1 = parse("profile = \"tk1\"\n[alarm]\ndistance_m = 7\n", Path::new("x")).unwrap();
        assert_eq!(tk1.alarm.distance_m, 7.0);
        assert_eq!(tk1.cores, load(Some(Path::new("tk1"))).unwrap().cores);
    }

    #[test]
    fn every_error_is_reported_at_once_with_its_line() {
        let text = "profile = \"tk2\"
[stereo]
disparities = 1000
lamda_vertical = 3
ssim_k2 = nan
[alarm]
distance_m = \"10\"
hold_ms = 1.5
[ipc]
[source]
kind = \"video\"
repeat = 1
[instance]
name = \"a b\"
";
        let got = errors(text);
        for (line, part) in [
            (1, "profile: give one of \"replay\""),
            (3, "stereo.disparities = 1000: give a whole number from 16 to 255"),
            (4, "unknown key stereo.lamda_vertical; did you mean stereo.lambda_vertical?"),
            (5, "stereo.ssim_k2 = nan: give a number"),
            (7, "alarm.distance_m = \"10\": give a number from 0.5 to 200"),
            (8, "alarm.hold_ms = 1.5: give a whole number"),
            (9, "unknown table [ipc]"),
            (11, "source.kind = \"video\": give one of \"scene\""),
            (12, "source.repeat = 1: give true or false"),
            (14, "instance.name = \"a b\": give 1 to 16 letters"),
        ] {
            let expected = format!("car.toml:{line}: {part}");
            assert!(got.iter().any(|e| e.starts_with(&expected)), "{expected}\nin {got:#?}");
        }
        assert_eq!(got.len(), 10, "{got:#?}");
        let got = errors("[regions]\nconfirm = false\n[tracking]\nconfirm_frames = 3\nforget_frames = 5\n");
        assert!(
            got[0].starts_with("car.toml:2: key regions.confirm is no longer used: remove it"),
            "{got:#?}"
        );
        assert!(
            got[1].contains("set tracking.confirm_probability") && got[2].contains("unseen_max_s"),
            "{got:#?}"
        );
        assert_eq!(got.len(), 3, "{got:#?}");
        let line = |e: &String| e.split(':').nth(1).and_then(|l| l.parse::<u32>().ok());
        assert!(got.windows(2).all(|w| line(&w[0]) <= line(&w[1])), "{got:#?}");
    }

    #[test]
    fn syntax_and_relations_have_lines_too() {
        assert!(errors("[alarm\n")[0].starts_with("car.toml:1: "), "{:?}", errors("[alarm\n"));
        assert!(errors("\n\nalarm = 3\n")[0].starts_with("car.toml:3: alarm is a table"));
        let crossed = errors("[regions]\nheight_max_m = 1\nheight_min_m = 2.5\n");
        assert!(
            crossed[0].starts_with("car.toml:3: regions.height_min_m = 2.5 is too high: at most 1"),
            "{crossed:?}"
        );
        for (text, expected) in [
            ("[source]\nfps = 1e-300\n", "source.fps = "),
            ("[alarm]\ndistance_m = 80\n", "alarm.distance_m = 80 is too high: at most 60"),
            ("[supervision]\nheartbeat_ms = 3000\n", "because of supervision.liveness_deadline_ms"),
            (
                "[stereo]\ngpu_timeout_ms = 2600\nbackend = \"gpu\"\n",
                "car.toml:2: stereo.gpu_timeout_ms = 2600 is too high: at most 2500, because of supervision.liveness_deadline_ms",
            ),
            (
                "[supervision]\nliveness_deadline_ms = 3000\n[stereo]\nbackend = \"gpu\"\n",
                "stereo.gpu_timeout_ms = 2000 is too high: at most 1500",
            ),
        ] {
            assert!(errors(text)[0].contains(expected), "{:?}", errors(text));
        }
        let missing = load(Some(Path::new("/no/such.toml"))).unwrap_err().to_string();
        assert!(missing.contains("/no/such.toml") && missing.contains("orin-nano"), "{missing}");
    }

    #[test]
    fn sizes_and_counts_beyond_the_limits_are_refused() {
        // 7 million keys, and 100 MB of brackets: refused before they are parsed.
        let keys: String = (0..7_000_000).map(|i| format!("k{i}=1\n")).collect();
        for text in [keys, "[".repeat(100_000_000)] {
            let got = errors(&text);
            let expected =
                format!("car.toml: {} bytes: a configuration has at most 262144; give", text.len());
            assert!(got.len() == 1 && got[0].starts_with(&expected), "{got:?}");
        }
        // The file is not even read.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sparse.toml");
        File::create(&path).unwrap().set_len(1 << 40).unwrap();
        let error = load(Some(&path)).unwrap_err().to_string();
        assert!(error.contains("sparse.toml: 1099511627776 bytes: a configuration has at most"), "{error}");
        // A file that does not say its size is read to the limit.
        let error = load(Some(Path::new("/dev/zero"))).unwrap_err().to_string();
        assert!(error.contains("/dev/zero: 262145 bytes"), "{error}");
        // Unknown keys: the first hundred are reported, the others counted.
        let many: String = (0..20_000).map(|i| format!("k{i}=1\n")).collect();
        let got = errors(&many);
        assert_eq!(got.len(), MAX_ERRORS + 1);
        assert_eq!(got[MAX_ERRORS], "car.toml: 19900 more errors: mend these 100 first");
    }

    #[test]
    fn errors_repeat_no_more_than_an_excerpt() {
        let long = "x".repeat(100_000);
        for text in [
            format!("{long} = 1\n"),
            format!("[alarm]\n{long} = 1\n"),
            format!("[alarm]\ndistance_m = \"{long}\"\n"),
            format!("[source]\npath = \"{long}\"\n"),
            format!("[recognition]\ncascade = [{}]\n", "1,".repeat(50_000)),
            format!("[alarm]\n{long} = 1\n{long} = 2\n"),
            format!("a = {}", "[".repeat(100_000)),
            format!("{} = 1", "a.".repeat(50_000)),
        ] {
            let got = errors(&text);
            assert!(got.iter().all(|error| error.len() < 1200), "{}", got[0].len());
        }
        assert!(errors("[source]\npath = 1\n")[0].contains("a path of at most 4095 bytes, in quotes"));
    }

    #[test]
    fn the_timeout_of_the_gpu_matters_only_where_a_gpu_may_be_used() {
        for (backend, is_built, expected) in [
            ("cpu", true, false),
            ("cpu", false, false),
            ("auto", true, true),
            ("auto", false, false),
            ("gpu", true, true),
            ("gpu", false, true),
        ] {
            assert_eq!(may_use_gpu(backend, is_built), expected, "{backend}, {is_built}");
        }
        let short = |stereo: &str| {
            let text = format!("[supervision]\nliveness_deadline_ms = 2500\n[stereo]\n{stereo}");
            parse(&text, Path::new("car.toml"))
        };
        assert!(short("backend = \"cpu\"").is_ok());
        assert!(short("backend = \"gpu\"").is_err());
        // The default, `auto`.
        assert_eq!(short("").is_err(), cfg!(feature = "gpu"), "{:?}", short("").err());
    }

    #[test]
    fn an_error_with_a_value_of_the_profile_has_the_line_of_the_file() {
        // The file lowers the maximum below the default minimum: the line is that of the file.
        let crossed = errors("[road]\ncamera_height_max_m = 0.2\n");
        assert!(crossed[0].starts_with("car.toml:2: "), "{crossed:?}");
    }
}
