//! The files that the configuration names: the source, the rig, models, certificates.

use super::finding::Finding;
use crate::command::check_config;
use crate::input::InputError;
use config::Config;

const AREA: &str = "files";

pub fn findings(config: &Config) -> Vec<Finding> {
    let remedy = "lookout check-config FILE tells the line; then correct it there";
    let (_, wrong) = check_config::wrong(config);
    let mut all: Vec<Finding> =
        wrong.into_iter().map(|(_, text)| Finding::problem(AREA, text, remedy)).collect();
    if !check_config::has_rig(config) {
        let remedy = "lookout calibrate --live camera writes one; docs/calibration.md";
        all.push(Finding::problem(AREA, InputError::NoRigOfCameras.to_string(), remedy));
    }
    if all.is_empty() {
        all.push(Finding::good(AREA, "all that the configuration names are there and fit"));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::super::finding::Level;
    use super::*;

    fn levels(text: &str) -> Vec<(Level, String)> {
        let config = config::parse(text, "car.toml".as_ref()).unwrap();
        findings(&config).into_iter().map(|finding| (finding.level, finding.text)).collect()
    }

    #[test]
    fn what_run_would_refuse_is_a_problem() {
        assert!(levels("").iter().all(|(level, _)| *level == Level::Good));
        let missing = levels("[source]\nkind = \"folder\"\npath = \"nowhere\"\nrig = \"no.toml\"\n");
        let told =
            |name: &str| missing.iter().any(|(level, text)| *level == Level::Problem && text.contains(name));
        assert!(told("nowhere") && told("no.toml"), "{missing:?}");
        let cameras = levels("[source]\nkind = \"camera\"\n");
        assert!(
            cameras
                .iter()
                .any(|(level, text)| *level == Level::Problem && text.contains("source.rig is empty")),
            "{cameras:?}"
        );
    }
}
