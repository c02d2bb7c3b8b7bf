//! The configuration of the daemon: typed, checked, with a reference that cannot go stale.
//!
//! A file is TOML. Keys that it leaves out come from the profile that it names (`profile = "tk1"`)
//! or from `replay`, the default. [`keys::all`] lists every key with its unit, range and effect;
//! checks, error texts and `docs/configuration.md` all come from that one table.

mod check;
pub mod keys;
mod model;
mod reference;

pub use check::{ConfigError, ConfigErrors, load, parse, profile_names};
pub use model::*;
pub use reference::reference;
