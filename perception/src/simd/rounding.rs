//! Conversion of floats to integers by operations that compilers vectorise. The cast `as` does not: it
//! branches in each lane on values that do not fit.

/// From 2²³ on an `f32` has no fractional bits, and its low bits are the integer.
const INTEGRAL: f32 = (1_u32 << 23) as f32;
/// From 2⁵² on an `f64` has no fractional bits.
const INTEGRAL_F64: f64 = (1_u64 << 52) as f64;
/// 1.5·2²³: leaves room for negative numbers.
const INTEGRAL_SIGNED: f32 = (3_u32 << 22) as f32;

/// Rounds towards zero; equal to `as i32` for magnitudes up to 2²³.
#[inline(always)]
pub fn truncate(value: f32) -> i32 {
    if cfg!(target_arch = "aarch64") {
        // One instruction for four lanes, which saturates.
        return value as i32;
    }
    let size = value.abs();
    let near = (size + INTEGRAL) - INTEGRAL;
    let floor = if near > size { near - 1.0 } else { near };
    let bits = ((floor + INTEGRAL).to_bits().wrapping_sub(INTEGRAL.to_bits())) as i32;
    if value < 0.0 { bits.wrapping_neg() } else { bits }
}

/// Rounds towards zero; equal to `as u32` for 0 to 2³².
#[inline(always)]
pub fn truncate_f64(value: f64) -> u32 {
    let near = value + INTEGRAL_F64;
    let floor = if near - INTEGRAL_F64 > value { near - 1.0 } else { near };
    floor.to_bits() as u32
}

/// Rounds to the nearest integer, halves to even; for magnitudes up to 2²².
#[inline(always)]
pub fn nearest(value: f32) -> i32 {
    (value + INTEGRAL_SIGNED).to_bits().wrapping_sub(INTEGRAL_SIGNED.to_bits()) as i32
}

/// Rounds to the nearest integer, halves to even; for 0 to 2³².
#[inline(always)]
pub fn nearest_f64(value: f64) -> u32 {
    (value + INTEGRAL_F64).to_bits() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_equal_those_of_the_standard_library() {
        let mut random = fastrand::Rng::with_seed(6);
        for _ in 0..20_000 {
            let value = (random.f32() - 0.5) * 1000.0;
            assert_eq!(truncate(value), value as i32, "{value}");
            assert_eq!(nearest(value), value.round_ties_even() as i32, "{value}");
            let value = random.f64() * 1e6;
            assert_eq!(truncate_f64(value), value as u32, "{value}");
            assert_eq!(nearest_f64(value), value.round_ties_even() as u32, "{value}");
        }
        for value in [0.0, 0.5, 1.0, 1.5, 2.5, 127.0, 127.5, 255.0, 4095.999] {
            assert_eq!((truncate(value), truncate(-value)), (value as i32, -(value as i32)));
            assert_eq!(nearest(-value), -(value.round_ties_even() as i32));
            let wide = f64::from(value);
            assert_eq!((truncate_f64(wide), nearest_f64(wide)), (wide as u32, wide.round_ties_even() as u32));
        }
    }
}
