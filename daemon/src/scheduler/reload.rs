//! A configuration that is read again while the daemon runs: what may change, and who has to know.
//!
//! A stage is furnished once, from its launch document; nothing in it changes while it works. So a
//! stage that reads a changed key is started anew, on the way that every restart takes, but without
//! waiting and without counting as a failure. The tables of the board are the scheduler's own and
//! hold at once. All other keys have shaped what is shared by all (memory, names, frames): they need
//! a restart of the daemon, and a configuration that changes one of them is refused as a whole.

use config::Config;
use messages::pipeline::Role;
use thiserror::Error;

/// What a changed key asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Effect {
    /// This stage starts anew.
    Stage(Role),
    /// All stages start anew.
    Stages,
    /// The scheduler takes it over.
    Own,
    /// It is no business of a running daemon.
    Others,
    /// The daemon would have to start anew.
    Restart,
}

fn effect(key: &str) -> Effect {
    match key.split_once('.').unwrap_or((key, "")) {
        // The one key of stereo that the size of things hangs on.
        ("stereo", "disparities") => Effect::Restart,
        ("stereo" | "calibration", _) => Effect::Stage(Role::Stereo),
        ("road" | "regions", _) => Effect::Stage(Role::Road),
        ("recognition" | "tracking" | "alarm", _) => Effect::Stage(Role::Recognition),
        ("log", _) => Effect::Stages,
        ("heat" | "clocks" | "board", _) => Effect::Own,
        // Read by another process when that starts.
        ("soak", _) => Effect::Others,
        _ => Effect::Restart,
    }
}

/// What has to be done.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// Keys that changed.
    pub keys: Vec<String>,
    /// Stages that start anew.
    pub roles: Vec<Role>,
    /// Whether a table of the board changed.
    pub board: bool,
}

/// Keys that cannot change while the daemon runs.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{} cannot change while the daemon runs: restart it", .0.join(", "))]
pub struct Refused(pub Vec<String>);

/// What has to be done to get from one configuration to another.
///
/// # Errors
/// Names the keys that forbid it.
pub fn plan(old: &Config, new: &Config) -> Result<Plan, Refused> {
    let (mut plan, mut refused) = (Plan::default(), Vec::new());
    let mut add = |role| {
        if !plan.roles.contains(&role) {
            plan.roles.push(role);
        }
    };
    let keys = changed(old, new);
    for key in &keys {
        match effect(key) {
            Effect::Stage(role) => add(role),
            Effect::Stages => Role::STAGES.into_iter().for_each(&mut add),
            Effect::Own => plan.board = true,
            Effect::Others => {}
            Effect::Restart => refused.push(key.clone()),
        }
    }
    plan.keys = keys;
    if refused.is_empty() { Ok(plan) } else { Err(Refused(refused)) }
}

/// Keys whose values differ.
fn changed(old: &Config, new: &Config) -> Vec<String> {
    let tables = |config: &Config| toml::Table::try_from(config).unwrap_or_default();
    let (old, new) = (tables(old), tables(new));
    config::keys::all()
        .filter(|key| {
            let (table, name) = key.name.split_once('.').unwrap_or((key.name, ""));
            let value = |tables: &toml::Table| tables.get(table).and_then(|t| t.get(name)).cloned();
            value(&old) != value(&new)
        })
        .map(|key| key.name.to_owned())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn config(text: &str) -> Config {
        config::parse(text, Path::new("x.toml")).unwrap()
    }

    #[test]
    fn stages_that_read_a_changed_key_start_anew() {
        let old = config("");
        assert_eq!(plan(&old, &old), Ok(Plan::default()));
        let new = config("[alarm]\ndistance_m = 12\n[tracking]\nconfirm_frames = 2\n[stereo]\nfill = true\n");
        let planned = plan(&old, &new).unwrap();
        assert_eq!(planned.roles, [Role::Stereo, Role::Recognition]);
        assert_eq!(planned.keys, ["stereo.fill", "tracking.confirm_frames", "alarm.distance_m"]);
        assert!(!planned.board);
        let planned = plan(&old, &config("[heat]\nstop_above_c = 94.5\n")).unwrap();
        assert!(planned.board && planned.roles.is_empty());
        let planned = plan(&old, &config("[soak]\nwarm_up_s = 2\n")).unwrap();
        assert_eq!((planned.keys.len(), planned.board, planned.roles.len()), (1, false, 0));
        assert_eq!(plan(&old, &config("[log]\nlevel = \"debug\"\n")).unwrap().roles, Role::STAGES);
    }

    #[test]
    fn a_change_of_what_all_share_is_refused_with_every_such_key() {
        let old = config("");
        let new = config("[alarm]\ndistance_m = 12\n[source]\nseed = 3\n[stereo]\ndisparities = 64\n");
        let refused = plan(&old, &new).unwrap_err();
        assert_eq!(refused, Refused(vec!["source.seed".into(), "stereo.disparities".into()]));
        assert!(refused.to_string().contains("source.seed, stereo.disparities cannot change while"));
    }
}
