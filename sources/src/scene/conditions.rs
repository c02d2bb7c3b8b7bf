//! Light, ground, precipitation, lens and sensor parameters of each weather.

use super::file::Weather;
use super::lens::{Glare, Lens};
use super::light::Light;
use super::mesh::unit;
use super::precipitation::Precipitation;
use super::sensor::Sensor;

/// Rendering parameters of a weather.
#[derive(Clone, Copy, Debug)]
pub struct Conditions {
    /// Light and atmosphere.
    pub light: Light,
    /// Wetness of the ground, 0 to 1.
    pub wet: f64,
    /// Share of the ground under snow, 0 to 1.
    pub snow: f64,
    /// Rain or snow.
    pub precipitation: Option<Precipitation>,
    /// Drops, film, glare and halo of the lenses.
    pub lens: Lens,
    /// Left and right sensor.
    pub sensors: [Sensor; 2],
}

/// Rain with `count` drops per image.
fn rain(count: u32, opacity: f32, grey: f32) -> Option<Precipitation> {
    Some(Precipitation {
        count,
        diameter_m: 0.0035,
        fall_m_s: 8.0,
        wind_m_s: 1.0,
        exposure_s: 0.008,
        grey,
        opacity,
    })
}

impl Conditions {
    /// Parameters of a weather.
    pub fn new(weather: Weather) -> Self {
        let sensor = |gain, offset, noise, shot_noise| Sensor { gain, offset, noise, shot_noise };
        // Real cameras differ: the right one is a little brighter.
        let pair =
            |noise: f32, shot: f32| [sensor(1.0, 0.0, noise, shot), sensor(1.04, 1.5, noise * 1.1, shot)];
        let fair = Self {
            light: Light::day(),
            wet: 0.0,
            snow: 0.0,
            precipitation: None,
            lens: Lens::default(),
            sensors: pair(0.8, 1.4),
        };
        match weather {
            Weather::Sunny => fair,
            Weather::Overcast => Self { light: Light::overcast(0.95), sensors: pair(1.0, 1.6), ..fair },
            Weather::LightRain => Self {
                light: Light { visibility_m: 300.0, ..Light::overcast(0.8) },
                wet: 0.55,
                precipitation: rain(1200, 0.8, 200.0),
                lens: Lens { drops: 5, ..Lens::default() },
                sensors: pair(1.4, 2.2),
                ..fair
            },
            Weather::HeavyRain => Self {
                light: Light { visibility_m: 90.0, ..Light::overcast(0.75) },
                wet: 1.0,
                precipitation: rain(4500, 1.0, 185.0),
                lens: Lens { drops: 18, film: 0.12, ..Lens::default() },
                sensors: pair(2.2, 3.2),
                ..fair
            },
            Weather::Night => Self {
                light: Light {
                    ambient: 0.14,
                    sun: 0.0,
                    sky: 14.0,
                    sky_rise: -6.0,
                    clouds: 0.1,
                    headlamps: 1.6,
                    visibility_m: 700.0,
                    air: 10.0,
                    lamps: true,
                    ..Light::day()
                },
                lens: Lens { halo: 0.6, ..Lens::default() },
                sensors: pair(2.5, 3.5),
                ..fair
            },
            Weather::Snow => Self {
                light: Light { visibility_m: 160.0, air: 200.0, ..Light::overcast(0.95) },
                snow: 0.92,
                precipitation: Some(Precipitation {
                    count: 1800,
                    diameter_m: 0.009,
                    fall_m_s: 1.3,
                    wind_m_s: 0.8,
                    exposure_s: 0.005,
                    grey: 232.0,
                    opacity: 0.85,
                }),
                lens: Lens { drops: 2, ..Lens::default() },
                sensors: pair(1.2, 1.8),
                ..fair
            },
            Weather::Backlight => Self {
                light: Light {
                    ambient: 0.36,
                    sun: 0.7,
                    towards_sun: unit([SUN.0, -SUN.1, 1.0]),
                    sky: 250.0,
                    sky_rise: 10.0,
                    sheen: 130.0,
                    ..Light::day()
                },
                lens: Lens { glare: Some(Glare { at: SUN, strength: 170.0 }), ..Lens::default() },
                sensors: pair(1.2, 1.8),
                ..fair
            },
        }
    }
}

/// Direction of a low sun: metres right and down per metre ahead.
const SUN: (f64, f64) = (0.1, -0.2);
