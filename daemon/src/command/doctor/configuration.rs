//! The files that the configuration names: the source, the rig, models, certificates.

use super::finding::Finding;
use crate::command::check_config;
use crate::input::InputError;
use config::Config;

const AREA: &str = "files";

pub fn findings(config: &Config) -> Vec<Finding> {
    let remedy = "correct it; of a file of configuration lookout check-config FILE tells the line";
    let (_, wrong) = check_config::wrong(config);
    // Cameras are an area of their own.
    let files = wrong.into_iter().filter(|(key, _)| *key != "camera.right");
    let mut all: Vec<Finding> = files.map(|(_, text)| Finding::problem(AREA, text, remedy)).collect();
    if !check_config::has_rig(config) {
        // As check-config has it: calibration comes after the first look at the cameras.
        let remedy = "lookout calibrate --live camera writes one, docs/calibration.md; until then lookout run refuses to start";
        all.push(Finding::note(AREA, InputError::NoRigOfCameras.to_string(), remedy));
    }
    if all.is_empty() {
        all.push(Finding::good(AREA, "all files that the configuration names exist and fit"));
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
    fn what_run_would_refuse_is_told() {
        assert!(levels("").iter().all(|(level, _)| *level == Level::Good));
        let missing = levels("[source]\nkind = \"folder\"\npath = \"nowhere\"\nrig = \"no.toml\"\n");
        let told =
            |name: &str| missing.iter().any(|(level, text)| *level == Level::Problem && text.contains(name));
        assert!(told("nowhere") && told("no.toml"), "{missing:?}");
        let cameras = levels("[source]\nkind = \"camera\"\n");
        assert!(
            cameras.iter().any(|(level, text)| *level == Level::Note && text.contains("source.rig is empty")),
            "{cameras:?}"
        );
    }
}
