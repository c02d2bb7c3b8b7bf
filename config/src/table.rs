//! The macros that declare tables and the configuration.

use crate::key::{Key, Kind, Reload};
use crate::stages::{PerStage, StageKey};
use messages::pipeline::Role;

/// A table as [`table!`] declares it.
pub trait Table {
    /// Description for the reference page.
    const TEXT: &'static str;

    /// Its keys; `table` is its name.
    fn keys(table: &'static str) -> Vec<Key>;
}

/// Declares a table of the configuration: its struct with defaults, and its keys.
///
/// ```text
/// table! {
///     /// What the table is about.
///     pub struct Alarm, reload: Reload::Readers;
///
///     /// What the key means.
///     hold_ms: Whole(0, 60_000) in "ms" = 1000;
///
///     /// The same with a reload class of its own.
///     history: Whole(1, 100) in "frames" = 10, reload: Reload::Restart;
/// }
/// ```
///
/// The doc comment of a key is both its rustdoc and its description on the reference page. A kind is one of
/// [`Kind`]'s: `Switch` (bool), `Automatic` ([`crate::automatic::Automatic`]), `Whole` (i64), `Number` (f64), `Choice` (String), `Name` (String), `Path` (PathBuf),
/// `Text` (String), `Detectors` (a list of tables). `in` gives the unit. The default may be any expression, such as the default of an
/// algorithm in `perception`.
///
/// A table that begins with `#[per_stage]` may have a key for each process: `stages: PerStage(Core);` with
/// `#[serde(flatten)]`; `{stage}` in its doc comment stands for the process name.
macro_rules! table {
    (#[per_stage] $($declaration:tt)*) => {
        $crate::table::table! { @declare [] $($declaration)* }
    };
    (
        @declare [$($deny:tt)*]
        $(#[doc = $about:literal])+
        pub struct $table:ident, reload: $class:expr;
        $(
            $(#[doc = $text:literal])+
            $(#[serde($flag:ident)])?
            $key:ident : $kind:ident $(($($range:tt)*))? $(in $unit:literal)? $(= $default:expr)?
                $(, reload: $own:expr)? ;
        )+
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        $($deny)*
        pub struct $table {
            $(
                $(#[doc = $text])+
                $(#[doc = concat!("\nUnit: ", $unit, ".")])?
                $(#[serde($flag)])?
                pub $key: $crate::table::kind!(type $kind $(($($range)*))?),
            )+
        }

        impl Default for $table {
            fn default() -> Self {
                Self { $($key: $crate::table::kind!(default $kind $(($($range)*))? $(= $default)?),)+ }
            }
        }

        impl $crate::table::Table for $table {
            const TEXT: &'static str = concat!($($about),+).trim_ascii();

            fn keys(table: &'static str) -> Vec<$crate::key::Key> {
                let default = Self::default();
                let mut keys = Vec::new();
                $(
                    let entry = $crate::table::Entry {
                        table,
                        name: stringify!($key),
                        unit: concat!($($unit)?),
                        text: concat!($($text),+).trim_ascii(),
                        // The key's own class, if it has one.
                        reload: [$($own,)? $class][0],
                    };
                    keys.extend($crate::table::kind!(
                        keys entry, default.$key, $kind $(($($range)*))?
                    ));
                )+
                keys
            }
        }
    };
    ($($declaration:tt)*) => {
        $crate::table::table! { @declare [#[serde(deny_unknown_fields)]] $($declaration)* }
    };
}

/// What follows from the kind of a key: its type, its default and its [`Key`].
macro_rules! kind {
    (type Switch) => { bool };
    (type Automatic) => { $crate::automatic::Automatic };
    (type Whole $range:tt) => { i64 };
    (type Number $range:tt) => { f64 };
    (type Choice $choices:tt) => { String };
    (type Name $most:tt) => { String };
    (type Path) => { std::path::PathBuf };
    (type Text $most:tt) => { String };
    (type Detectors $most:tt) => { Vec<RecognitionDetector> };
    (type PerStage ($key:ty)) => { $crate::stages::PerStage<$key> };

    (default Whole $range:tt = $default:expr) => { $crate::table::whole($default) };
    (default PerStage $key:tt) => { Default::default() };
    (default Detectors $most:tt = $default:expr) => { $default };
    (default $kind:ident $(($($range:tt)*))? = $default:expr) => { $default.into() };

    (keys $entry:ident, $value:expr, PerStage $key:tt) => { $entry.per_stage(&$value) };
    (keys $entry:ident, $value:expr, $kind:ident $($range:tt)?) => {
        $entry.key($crate::key::Kind::$kind $($range)?, &$value)
    };
}

/// Declares the configuration by its tables.
macro_rules! configuration {
    ($(#[$about:meta])+ pub struct $config:ident { $($table:ident : $type:ident,)+ }) => {
        $(#[$about])+
        #[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $config {
            $(
                #[doc = concat!("The table `[", stringify!($table), "]`.")]
                pub $table: $type,
            )+
        }

        /// The tables with their keys.
        pub(crate) fn declared() -> Vec<$crate::key::Table> {
            vec![$(
                $crate::key::Table {
                    name: stringify!($table),
                    text: <$type as $crate::table::Table>::TEXT,
                    keys: <$type as $crate::table::Table>::keys(stringify!($table)),
                },
            )+]
        }
    };
}

pub(crate) use {configuration, kind, table};

/// A whole number of any type as the configuration holds it. None of the defaults is too large for that.
pub fn whole(value: impl TryInto<i64>) -> i64 {
    value.try_into().unwrap_or(i64::MAX)
}

/// What [`table!`] reads of a key beside its kind.
pub struct Entry {
    pub table: &'static str,
    pub name: &'static str,
    pub unit: &'static str,
    pub text: &'static str,
    pub reload: Reload,
}

impl Entry {
    /// The key of this declaration.
    pub fn key(&self, kind: Kind, default: &impl serde::Serialize) -> Vec<Key> {
        let &Self { table, name, unit, text, reload } = self;
        // A bool, a number or a string: all of them have a TOML form.
        let default = toml::Value::try_from(default).unwrap_or_else(|_| String::new().into());
        vec![Key { table, name: name.to_owned(), kind, unit, text: text.to_owned(), reload, default }]
    }

    /// A key for each process.
    pub fn per_stage<K: StageKey>(&self, defaults: &PerStage<K>) -> Vec<Key> {
        let &Self { table, unit, text, reload, .. } = self;
        let key = |(role, value): (Role, i64)| Key {
            table,
            name: PerStage::<K>::name(role),
            kind: Kind::Whole(K::RANGE.0, K::RANGE.1),
            unit,
            text: text.replace("{stage}", role.name()),
            reload,
            default: value.into(),
        };
        defaults.iter().map(key).collect()
    }
}
