//! What a key of the configuration is: what it holds, its unit, and what a reload does with it.

use crate::limits::MAX_PATH_BYTES;
use messages::pipeline::Role;
use std::fmt;

/// What a key holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// true or false.
    Switch,
    /// "auto", true or false.
    Automatic,
    /// A whole number in a range.
    Whole(i64, i64),
    /// A number in a range.
    Number(f64, f64),
    /// One of a few strings.
    Choice(&'static [&'static str]),
    /// Letters, digits, `-` and `_`, at most this many.
    Name(usize),
    /// A path of at most [`MAX_PATH_BYTES`]; may be empty.
    Path,
    /// One line of at most this many characters; may be empty.
    Text(usize),
    /// A list of at most this many tables, whose keys [`crate::keys::detectors`] lists.
    Detectors(usize),
}

/// The requirement on a value, as error messages and the reference page say it.
impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Kind::Switch => f.write_str("true or false"),
            Kind::Automatic => f.write_str("\"auto\", true or false"),
            Kind::Whole(low, high) => write!(f, "a whole number from {low} to {high}"),
            Kind::Number(low, high) => write!(f, "a number from {low} to {high}"),
            Kind::Choice(words) => write!(f, "one of \"{}\"", words.join("\", \"")),
            Kind::Name(most) => write!(f, "1 to {most} letters, digits, - or _, in quotes"),
            Kind::Path => write!(f, "a path of at most {MAX_PATH_BYTES} bytes, in quotes"),
            Kind::Text(most) => write!(f, "one line of at most {most} characters, in quotes"),
            Kind::Detectors(most) => write!(f, "at most {most} tables [[recognition.detectors]], or []"),
        }
    }
}

/// What a running daemon does when a key has changed at a reload (SIGHUP).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reload {
    /// Restarts the stages that read the table, as [`messages::pipeline`] lists them.
    Readers,
    /// Restarts all stages.
    AllStages,
    /// The scheduler applies it at once.
    Scheduler,
    /// Nothing: another process reads it when that starts.
    OtherProcess,
    /// Refuses the whole configuration: memory, names or frames that all processes share depend on the key.
    Restart,
}

/// One key.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// Its table.
    pub table: &'static str,
    /// Its name in the table.
    pub name: String,
    /// What it holds.
    pub kind: Kind,
    /// Unit of a number; empty where it has none.
    pub unit: &'static str,
    /// Description for the reference page.
    pub text: String,
    /// What a reload does when the value has changed.
    pub reload: Reload,
    /// Value where no profile and no file sets one.
    pub default: toml::Value,
}

impl Key {
    /// Table and name, with a dot.
    pub fn path(&self) -> String {
        format!("{}.{}", self.table, self.name)
    }

    /// The stages that a reload restarts when the value has changed.
    pub fn restarts(&self) -> impl Iterator<Item = Role> {
        // A list of tables is read with the table that holds it.
        let table = self.table.split('.').next().unwrap_or(self.table);
        Role::STAGES.into_iter().filter(move |role| match self.reload {
            Reload::Readers => role.spec().config_tables.contains(&table),
            Reload::AllStages => true,
            Reload::Scheduler | Reload::OtherProcess | Reload::Restart => false,
        })
    }

    /// The column "on reload" of the reference page.
    pub(crate) fn on_reload(&self) -> String {
        match self.reload {
            Reload::Readers => {
                format!("restarts {}", self.restarts().map(Role::name).collect::<Vec<_>>().join(", "))
            }
            Reload::AllStages => "restarts all stages".into(),
            Reload::Scheduler => "applied at once".into(),
            Reload::OtherProcess => "not used by the daemon".into(),
            Reload::Restart => "refused: restart the daemon".into(),
        }
    }
}

/// One table.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Its name.
    pub name: &'static str,
    /// Description for the reference page.
    pub text: &'static str,
    /// Its keys, in the order of the declaration.
    pub keys: Vec<Key>,
}
