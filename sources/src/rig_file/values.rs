//! Numbers of calibration files, and what is made of them.

use super::rotation;
use super::yaml::Value;
use crate::limits::MAX_SIDE_PX;
use nalgebra::Rotation3;
use perception::calibration::{Camera, Distortion, Pose};
use perception::excerpt::{VALUE_CHARS, excerpt};

/// Left and right camera, the transform between them, and the size of their pictures.
pub(super) type Cameras = ([Camera; 2], Pose, (usize, usize));

/// Exactly `N` numbers under a key.
pub(super) fn numbers<const N: usize>(value: &Value, key: &str) -> Result<[f64; N], String> {
    let found = value.get(key).ok_or_else(|| format!("{key} is missing"))?;
    let list = found.numbers().ok_or_else(|| format!("{key} contains an item that is not a number"))?;
    let count = list.len();
    list.try_into().map_err(|_| format!("{key} has {count} numbers, not {N}"))
}

pub(super) fn camera(k: &[f64; 9], distortion: &[f64]) -> Result<Camera, String> {
    if distortion.len() > 8 && distortion[8..].iter().any(|v| *v != 0.0) {
        return Err("thin-prism and tilted lenses (more than 8 coefficients) are not supported".into());
    }
    let mut all = [0.0; 8];
    for (a, d) in all.iter_mut().zip(distortion) {
        *a = *d;
    }
    let distortion = Distortion::BrownConrady(all);
    Ok(Camera { fx_px: k[0], fy_px: k[4], cx_px: k[2], cy_px: k[5], distortion })
}

/// A fisheye camera: the equidistant model, with four coefficients.
pub(super) fn fisheye(k: &[f64; 9], distortion: &[f64]) -> Result<Camera, String> {
    let count = distortion.len();
    let four = distortion.try_into();
    let four = four.map_err(|_| format!("a fisheye lens has 4 distortion coefficients, not {count}"))?;
    let distortion = Distortion::Equidistant(four);
    Ok(Camera { fx_px: k[0], fy_px: k[4], cx_px: k[2], cy_px: k[5], distortion })
}

/// The camera and the picture size of a table of Kalibr or EuRoC, which have the same keys but for `coefficients`, the key of the
/// distortion coefficients, and `radial`, the name of the Brown–Conrady model.
pub(super) fn pinhole(
    table: &Value,
    radial: &str,
    coefficients: &str,
) -> Result<(Camera, (usize, usize)), String> {
    let word = |name: &str| table.get(name).and_then(Value::word).unwrap_or("");
    let not = |name: &str, supported: &str| {
        format!("{name} is \"{}\": {supported} is supported", excerpt(word(name), VALUE_CHARS))
    };
    if word("camera_model") != "pinhole" {
        return Err(not("camera_model", "pinhole"));
    }
    let lens = match word("distortion_model") {
        "equidistant" => fisheye,
        model if model == radial => camera,
        _ => return Err(not("distortion_model", &format!("{radial} or equidistant"))),
    };
    let [fx, fy, cx, cy] = numbers(table, "intrinsics")?;
    let d: [f64; 4] = numbers(table, coefficients)?;
    let [w, h] = numbers(table, "resolution")?;
    Ok((lens(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], &d)?, (pixels(w)?, pixels(h)?)))
}

pub(super) fn turn(m: &[f64; 9], what: &str) -> Result<Rotation3<f64>, String> {
    rotation(&[[m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]], what)
}

pub(super) fn pixels(value: f64) -> Result<usize, String> {
    if (1.0..=f64::from(MAX_SIDE_PX)).contains(&value) && value.fract() == 0.0 {
        Ok(value as usize)
    } else {
        Err(format!("invalid image width or height: {value} px"))
    }
}
