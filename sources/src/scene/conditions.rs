//! What the weather makes of light, ground and sensors.

use super::file::Weather;
use super::light::Light;
use super::mesh::unit;
use super::sensor::Sensor;

/// A weather, in numbers.
#[derive(Clone, Copy, Debug)]
pub struct Conditions {
    /// Light and air.
    pub light: Light,
    /// How wet the ground is, 0 to 1.
    pub wet: f64,
    /// Share of the ground under snow.
    pub snow: f64,
    /// Left and right sensor.
    pub sensors: [Sensor; 2],
}

impl Conditions {
    /// The weather's numbers.
    pub fn new(weather: Weather) -> Self {
        let sensor = |gain, offset, noise, shot_noise| Sensor { gain, offset, noise, shot_noise };
        // No two cameras are alike: the right one is a little brighter.
        let pair =
            |noise: f32, shot: f32| [sensor(1.0, 0.0, noise, shot), sensor(1.04, 1.5, noise * 1.1, shot)];
        let fair = Self { light: Light::day(), wet: 0.0, snow: 0.0, sensors: pair(0.8, 1.4) };
        match weather {
            Weather::Sunny => fair,
            Weather::Overcast => Self { light: Light::overcast(0.95), sensors: pair(1.0, 1.6), ..fair },
            Weather::LightRain => Self {
                light: Light { visibility_m: 300.0, ..Light::overcast(0.8) },
                wet: 0.55,
                sensors: pair(1.4, 2.2),
                ..fair
            },
            Weather::HeavyRain => Self {
                light: Light { visibility_m: 90.0, ..Light::overcast(0.62) },
                wet: 1.0,
                sensors: pair(2.2, 3.2),
                ..fair
            },
            Weather::Night => Self {
                light: Light {
                    ambient: 0.1,
                    sun: 0.0,
                    sky: 14.0,
                    sky_rise: -6.0,
                    clouds: 0.1,
                    headlamps: 1.25,
                    visibility_m: 700.0,
                    air: 10.0,
                    lamps: true,
                    ..Light::day()
                },
                sensors: pair(3.0, 4.0),
                ..fair
            },
            Weather::Snow => Self {
                light: Light { visibility_m: 160.0, air: 200.0, ..Light::overcast(0.95) },
                snow: 0.92,
                sensors: pair(1.2, 1.8),
                ..fair
            },
            Weather::Backlight => Self {
                light: Light {
                    ambient: 0.4,
                    sun: 0.75,
                    towards_sun: unit([0.12, 0.2, 1.0]),
                    sky: 250.0,
                    sky_rise: 10.0,
                    ..Light::day()
                },
                sensors: pair(1.2, 1.8),
                ..fair
            },
        }
    }
}
