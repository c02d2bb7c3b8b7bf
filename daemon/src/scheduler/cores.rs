//! Assignment of processes to cores.

use config::Cores;
use messages::pipeline::Role;

/// The core of each role.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CorePlan {
    cores: Vec<(Role, Option<usize>)>,
    available: Vec<usize>,
}

impl CorePlan {
    /// Assigns each role its configured core. If the core is not in `available`, it is replaced by entry (number modulo
    /// count) of `available`. Without `pin`, or if `available` is empty, no process is pinned.
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
        let cores = Role::ALL.map(|role| (role, core(wanted.of(role)))).to_vec();
        Self { cores, available: available.to_vec() }
    }

    /// Cores for `count` further threads of a role, the best first; in turns if there are fewer. `capacity` tells how fast a core
    /// is: a thread on a slow one would keep the others waiting. The scheduler's core and core 0, which serve what has no
    /// priority and the interrupts, come late. Else cores without a process come first, then those of other processes, the
    /// last stage first, because its work is the shortest. Empty if the role is not pinned, or has the only core.
    pub fn helpers(&self, role: Role, count: usize, capacity: impl Fn(usize) -> Option<u32>) -> Vec<usize> {
        let Some(own) = self.core(role) else { return Vec::new() };
        let order = |core: usize| {
            let first = self.cores.iter().position(|(_, taken)| *taken == Some(core));
            let serves_others = core == 0 || self.core(Role::Scheduler) == Some(core);
            let rank = first.map_or(0, |place| self.cores.len() - place);
            (capacity(core) != capacity(own), serves_others, rank)
        };
        let mut cores: Vec<usize> = self.available.iter().copied().filter(|&core| core != own).collect();
        cores.sort_by_key(|&core| order(core));
        cores.iter().copied().cycle().take(if cores.is_empty() { 0 } else { count }).collect()
    }

    /// The core of a role; `None` if it is not pinned.
    pub fn core(&self, role: Role) -> Option<usize> {
        self.cores.iter().find(|(r, _)| *r == role).and_then(|(_, core)| *core)
    }

    /// Description of the assignment, for example "core 0: scheduler, capture; core 1: stereo".
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

    #[test]
    fn every_role_has_its_core_when_there_are_enough() {
        let plan = CorePlan::new(&Cores::default(), &[0, 1, 2, 3]);
        let cores = Role::ALL.map(|role| plan.core(role));
        assert_eq!(cores, [Some(0), Some(0), Some(1), Some(2), Some(3), Some(0)]);
    }

    #[test]
    fn on_fewer_cores_roles_share_cores_and_the_description_lists_them() {
        let plan = CorePlan::new(&Cores::default(), &[0, 1]);
        assert_eq!(plan.core(Role::Recognition), Some(1));
        let text = plan.describe(&Role::ALL);
        assert_eq!(text, "core 0: scheduler, capture, road, writer; core 1: stereo, recognition");
        // The cores of a cpuset need not start at 0.
        let plan = CorePlan::new(&Cores::default(), &[4, 6]);
        assert_eq!((plan.core(Role::Capture), plan.core(Role::Stereo)), (Some(4), Some(6)));
    }

    #[test]
    fn further_threads_get_free_cores_of_the_same_kind_first() {
        let alike = |_| None;
        let plan = CorePlan::new(&Cores::default(), &[0, 1, 2, 3, 4, 5]);
        assert_eq!(plan.helpers(Role::Stereo, 3, alike), [4, 5, 3]);
        let plan = CorePlan::new(&Cores::default(), &[0, 1, 2, 3]);
        assert_eq!(
            plan.helpers(Role::Stereo, 4, alike),
            [3, 2, 0, 3],
            "recognition's, road's, the scheduler's, and again"
        );
        // Four small cores, and four large ones that all have a process.
        let cores = "scheduler = 1\ncapture = 4\nstereo = 7\nroad = 6\nrecognition = 5\n";
        let config = config::parse(&format!("[cores]\n{cores}"), std::path::Path::new("x.toml")).unwrap();
        let plan = CorePlan::new(&config.cores, &[0, 1, 2, 3, 4, 5, 6, 7]);
        let capacity = |core| Some(if core < 4 { 380 } else { 1024 });
        assert_eq!(plan.helpers(Role::Stereo, 5, capacity), [5, 6, 4, 2, 3]);
        assert!(CorePlan::new(&Cores::default(), &[7]).helpers(Role::Stereo, 2, alike).is_empty());
        let free = CorePlan::new(&Cores { pin: false, ..Cores::default() }, &[0, 1]);
        assert!(free.helpers(Role::Stereo, 1, alike).is_empty());
    }

    #[test]
    fn nothing_is_pinned_if_pinning_is_off_or_no_core_is_known() {
        let plan = CorePlan::new(&Cores { pin: false, ..Cores::default() }, &[0, 1]);
        assert_eq!(plan.core(Role::Stereo), None);
        assert_eq!(plan.describe(&Role::ALL), "no process is pinned");
        assert_eq!(CorePlan::new(&Cores::default(), &[]).core(Role::Stereo), None);
    }
}
