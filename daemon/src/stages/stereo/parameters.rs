//! Parameters of the matcher from the configuration.

use crate::stages::whole_number::whole;
use config::Config;
use perception::stereo::MpvParameters;
use perception::stereo::cost::CostParameters;
use perception::stereo::fill::BridgeParameters;
use perception::stereo::scale::PathParameters;
use perception::stereo::speckle::SpeckleParameters;
use perception::stereo::viterbi::Merge;
use perception::stereo::winner::{SubPixel, WinnerParameters};

/// Parameters of the matcher.
pub fn mpv_parameters(config: &Config) -> MpvParameters {
    let c = &config.stereo;
    let default = MpvParameters::default();
    MpvParameters {
        cost: CostParameters { k2: c.ssim_k2 as f32, gradient_limit: whole(c.gradient_limit) },
        paths: PathParameters {
            lambda_horizontal: whole(c.lambda_horizontal),
            lambda_vertical: whole(c.lambda_vertical),
            lambda_diagonal: whole(c.lambda_diagonal),
            truncation_horizontal: whole(c.truncation_horizontal),
            truncation_other: whole(c.truncation_other),
            edge_levels: whole(c.edge_levels),
            edge_percent: whole(c.edge_percent),
            merging: if c.merging == "mean" { Merge::Mean } else { Merge::Min },
        },
        scales: whole(c.scales),
        slopes: c.slopes,
        winner: WinnerParameters {
            left_right_px: whole(c.left_right_px),
            sub_pixel: match &c.sub_pixel[..] {
                "none" => SubPixel::None,
                "energy" => SubPixel::Energy,
                _ => SubPixel::Data,
            },
            ..default.winner
        },
        min_confidence: whole(c.confidence_min),
        speckle: SpeckleParameters { min_pixels: whole(c.speckle_pixels), ..default.speckle },
        bridge: BridgeParameters { widest_px: whole(c.bridge_px), ..default.bridge },
        complete: c.fill,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_configuration_matches_the_defaults_of_the_algorithms() {
        assert_eq!(mpv_parameters(&Config::default()), MpvParameters::default());
    }
}
