//! Which process runs on which core.

use config::Cores;
use messages::pipeline::Role;

/// The core of each role.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CorePlan {
    cores: Vec<(Role, Option<usize>)>,
}

impl CorePlan {
    /// Gives every role its core of the `available` ones. A core that the machine lacks is
    /// replaced: its number modulo how many there are. Without `pin`, or when no core is known,
    /// nothing is pinned.
    pub fn new(wanted: &Cores, available: &[usize]) -> Self {
        let core = |number: i64| {
            let number = usize::try_from(number).unwrap_or(0);
            if !wanted.pin || available.is_empty() {
                None
            } else if available.contains(&number) {
                Some(number)
            } else {
                Some(available[number % available.len()])
            }
        };
        // The writer keeps the scheduler company: it may be late, the stages may not.
        let wishes = [
            (Role::Scheduler, wanted.scheduler),
            (Role::Capture, wanted.capture),
            (Role::Stereo, wanted.stereo),
            (Role::Road, wanted.road),
            (Role::Recognition, wanted.recognition),
            (Role::Writer, wanted.scheduler),
        ];
        Self { cores: wishes.map(|(role, number)| (role, core(number))).to_vec() }
    }

    /// The core of a role; `None` when it is not pinned.
    pub fn core(&self, role: Role) -> Option<usize> {
        self.cores.iter().find(|(r, _)| *r == role).and_then(|(_, core)| *core)
    }

    /// In words, which roles share a core: "core 0: scheduler, capture; core 1: stereo".
    pub fn describe(&self, roles: &[Role]) -> String {
        let mut groups: Vec<(usize, Vec<&str>)> = Vec::new();
        for &role in roles {
            if let Some(core) = self.core(role) {
                match groups.iter_mut().find(|(c, _)| *c == core) {
                    Some((_, names)) => names.push(role.name()),
                    None => groups.push((core, vec![role.name()])),
                }
            }
        }
        groups.sort_unstable_by_key(|(core, _)| *core);
        if groups.is_empty() {
            return "no process is pinned".into();
        }
        let parts: Vec<String> =
            groups.iter().map(|(core, names)| format!("core {core}: {}", names.join(", "))).collect();
        parts.join("; ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WANTED: Cores = Cores { pin: true, scheduler: 0, capture: 0, stereo: 1, road: 2, recognition: 3 };

    #[test]
    fn every_role_has_its_core_when_there_are_enough() {
        let plan = CorePlan::new(&WANTED, &[0, 1, 2, 3]);
        let cores = Role::ALL.map(|role| plan.core(role));
        assert_eq!(cores, [Some(0), Some(0), Some(1), Some(2), Some(3), Some(0)]);
    }

    #[test]
    fn on_fewer_cores_roles_are_doubled_up_and_it_says_how() {
        let plan = CorePlan::new(&WANTED, &[0, 1]);
        assert_eq!(plan.core(Role::Recognition), Some(1));
        let text = plan.describe(&Role::ALL);
        assert_eq!(text, "core 0: scheduler, capture, road, writer; core 1: stereo, recognition");
        // Cores of a cpuset need not start at 0.
        let plan = CorePlan::new(&WANTED, &[4, 6]);
        assert_eq!((plan.core(Role::Capture), plan.core(Role::Stereo)), (Some(4), Some(6)));
    }

    #[test]
    fn nothing_is_pinned_when_that_is_off_or_impossible() {
        let plan = CorePlan::new(&Cores { pin: false, ..WANTED }, &[0, 1]);
        assert_eq!(plan.core(Role::Stereo), None);
        assert_eq!(plan.describe(&Role::ALL), "no process is pinned");
        assert_eq!(CorePlan::new(&WANTED, &[]).core(Role::Stereo), None);
    }
}
