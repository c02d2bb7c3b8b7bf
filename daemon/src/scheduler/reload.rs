//! Reload: the configuration is read again while the daemon runs.
//!
//! The declaration of each key states what a change of its value requires ([`Reload`]). A stage is configured once, at
//! start, from its launch document, so a stage that reads a changed key is restarted: in the same way as at any
//! restart, but without delay and without counting as a failure. The scheduler applies the tables of the board at once.
//! All other keys determine what all processes share (memory, names, frames): a configuration that changes one of them
//! is refused as a whole.

use config::Config;
use config::keys::{Key, Reload};
use messages::pipeline::Role;
use thiserror::Error;

/// Actions of a reload.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// Keys that changed.
    pub keys: Vec<String>,
    /// Stages that are restarted.
    pub roles: Vec<Role>,
    /// Whether a table of the board changed.
    pub board: bool,
}

/// Keys that cannot change while the daemon runs.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{} cannot change while the daemon runs: restart it", .0.join(", "))]
pub struct Refused(pub Vec<String>);

/// The actions of a reload from one configuration to another.
///
/// # Errors
/// The keys that cannot change while the daemon runs.
pub fn plan(old: &Config, new: &Config) -> Result<Plan, Refused> {
    let (mut plan, mut refused) = (Plan::default(), Vec::new());
    let mut add = |role| {
        if !plan.roles.contains(&role) {
            plan.roles.push(role);
        }
    };
    for key in changed(old, new) {
        match key.reload {
            Reload::Readers | Reload::AllStages => key.restarts().for_each(&mut add),
            Reload::Scheduler => plan.board = true,
            Reload::OtherProcess => {}
            Reload::Restart => refused.push(key.path()),
        }
        plan.keys.push(key.path());
    }
    if refused.is_empty() { Ok(plan) } else { Err(Refused(refused)) }
}

/// Keys whose values differ.
fn changed(old: &Config, new: &Config) -> Vec<&'static Key> {
    let tables = |config: &Config| toml::Table::try_from(config).unwrap_or_default();
    let (old, new) = (tables(old), tables(new));
    let value = |tables: &toml::Table, key: &Key| tables.get(key.table)?.get(&key.name).cloned();
    config::keys::all().filter(|key| value(&old, key) != value(&new, key)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn config(text: &str) -> Config {
        config::parse(text, Path::new("x.toml")).unwrap()
    }

    #[test]
    fn stages_that_read_a_changed_key_are_restarted() {
        let old = config("");
        assert_eq!(plan(&old, &old), Ok(Plan::default()));
        let new = config(
            "[alarm]\ndistance_m = 12\n[tracking]\nconfirm_probability = 0.8\n[stereo]\nfill = true\n",
        );
        let planned = plan(&old, &new).unwrap();
        assert_eq!(planned.roles, [Role::Stereo, Role::Road, Role::Recognition]);
        assert_eq!(planned.keys, ["stereo.fill", "tracking.confirm_probability", "alarm.distance_m"]);
        assert!(!planned.board);
        let planned = plan(&old, &config("[heat]\nstop_above_c = 94.5\n")).unwrap();
        assert!(planned.board && planned.roles.is_empty());
        let planned = plan(&old, &config("[soak]\nwarm_up_s = 2\n")).unwrap();
        assert_eq!((planned.keys.len(), planned.board, planned.roles.len()), (1, false, 0));
        assert_eq!(plan(&old, &config("[log]\nlevel = \"debug\"\n")).unwrap().roles, Role::STAGES);
        // Several stages read this one of the alarm's keys.
        assert_eq!(plan(&old, &config("[alarm]\nself_check = false\n")).unwrap().roles, Role::STAGES);
    }

    #[test]
    fn a_change_of_a_shared_key_is_refused_and_every_such_key_is_named() {
        let old = config("");
        let new = config("[alarm]\ndistance_m = 12\n[source]\nseed = 3\n[stereo]\ndisparities = 64\n");
        let refused = plan(&old, &new).unwrap_err();
        assert_eq!(refused, Refused(vec!["source.seed".into(), "stereo.disparities".into()]));
        assert!(refused.to_string().contains("source.seed, stereo.disparities cannot change while"));
    }
}
