//! Whole numbers of floats, by operations that compilers do for many lanes at once: `as` is a branch for what
//! does not fit, in each lane.

/// From here on floats have no places behind the point, and their last bits are the whole number.
const PLAIN: f32 = (1_u32 << 23) as f32;
const PLAIN_F64: f64 = (1_u64 << 52) as f64;
/// The same with room for numbers below zero.
const EITHER: f32 = (3_u32 << 22) as f32;

/// The whole number next to a small one on the way to zero, as `as i32` gives it up to 2²³.
#[inline(always)]
pub fn whole(value: f32) -> i32 {
    let size = value.abs();
    let near = (size + PLAIN) - PLAIN;
    let floor = if near > size { near - 1.0 } else { near };
    let bits = ((floor + PLAIN).to_bits().wrapping_sub(PLAIN.to_bits())) as i32;
    if value < 0.0 { bits.wrapping_neg() } else { bits }
}

/// The same of a number from 0 to 2³².
#[inline(always)]
pub fn whole_f64(value: f64) -> u32 {
    let near = value + PLAIN_F64;
    let floor = if near - PLAIN_F64 > value { near - 1.0 } else { near };
    floor.to_bits() as u32
}

/// The nearest whole number, the even one of two; up to 2²² to either side.
#[inline(always)]
pub fn nearest(value: f32) -> i32 {
    (value + EITHER).to_bits().wrapping_sub(EITHER.to_bits()) as i32
}

/// The same of a number from 0 to 2³².
#[inline(always)]
pub fn nearest_f64(value: f64) -> u32 {
    (value + PLAIN_F64).to_bits() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_those_of_the_language() {
        let mut random = fastrand::Rng::with_seed(6);
        for _ in 0..20_000 {
            let value = (random.f32() - 0.5) * 1000.0;
            assert_eq!(whole(value), value as i32, "{value}");
            assert_eq!(nearest(value), value.round_ties_even() as i32, "{value}");
            let value = random.f64() * 1e6;
            assert_eq!(whole_f64(value), value as u32, "{value}");
            assert_eq!(nearest_f64(value), value.round_ties_even() as u32, "{value}");
        }
        for value in [0.0, 0.5, 1.0, 1.5, 2.5, 127.0, 127.5, 255.0, 4095.999] {
            assert_eq!((whole(value), whole(-value)), (value as i32, -(value as i32)));
            assert_eq!(nearest(-value), -(value.round_ties_even() as i32));
            let wide = f64::from(value);
            assert_eq!((whole_f64(wide), nearest_f64(wide)), (wide as u32, wide.round_ties_even() as u32));
        }
    }
}
