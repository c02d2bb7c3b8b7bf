//! The configuration of the daemon: typed and checked, with a generated reference page.
//!
//! A file is TOML. Keys that it leaves out come from the profile that it names (`profile = "tk1"`), or
//! else from the defaults. Each key is declared once, in the `tables` module: type, default, range, unit, documentation
//! and what a reload does with it. The types here, the checks, error messages, `docs/configuration.md` and
//! the reload of a running daemon are derived from that declaration ([`keys::all`]).

pub mod automatic;
mod check;
mod key;
pub mod keys;
pub mod limits;
mod paths;
mod profile;
mod reference;
pub mod stages;
mod table;
mod tables;

pub use check::{ConfigError, ConfigErrors, load, parse};
pub use paths::place;
pub use profile::profile_names;
pub use reference::reference;
pub use tables::*;
