//! `lookout check-config`.

use super::{CommandError, say};
use crate::cli::CheckConfig;
use crate::rooms;

pub fn run(args: &CheckConfig) -> Result<(), CommandError> {
    if args.reference {
        return say(config::reference().trim_end());
    }
    let config = config::load(args.file.as_deref())?;
    // What the configuration names must be there and sound, too.
    rooms::recogniser(&config, 8, 8)?;
    if !config.source.rig.as_os_str().is_empty() {
        sources::calibration_file::read(&config.source.rig, true)?;
    }
    let text = toml::to_string(&config).map_err(|e| CommandError::Other(e.to_string()))?;
    say(format_args!("# The effective configuration. No errors.\n{text}"))
}

#[cfg(test)]
mod tests {
    use crate::rooms;
    use config::Config;
    use perception::alarm::AlarmParameters;
    use perception::scene::SceneParameters;
    use perception::stereo::MpvParameters;
    use perception::tracking::TrackerParameters;
    use perception::tracking::classification_schedule::ScheduleParameters;

    #[test]
    fn the_default_configuration_gives_the_default_parameters_of_the_algorithms() {
        let config = Config::default();
        assert_eq!(rooms::mpv_parameters(&config), MpvParameters::default());
        assert_eq!(rooms::scene_parameters(&config), SceneParameters::default());
        assert_eq!(rooms::tracker_parameters(&config), TrackerParameters::default());
        assert_eq!(rooms::alarm_parameters(&config), AlarmParameters::default());
        assert_eq!(rooms::look_parameters(&config), ScheduleParameters::default());
    }
}
