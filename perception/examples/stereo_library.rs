//! The CPU matcher as a shared library with one C function, for programs that benchmark or evaluate several
//! matchers. Build with `cargo build --release -p lookout-perception --example stereo_library`. The environment variable
//! `LOOKOUT_LEVEL` names the fastest instruction-set level to use, if the machine supports it.

use lookout_perception::image::GreyView;
use lookout_perception::simd::Level;
use lookout_perception::stereo::{Crew, MatchOutput, Matcher, Mpv, MpvParameters, Search};
use std::sync::Mutex;

/// Cache of matchers, because a program calls with the same parameters many times.
static MATCHERS: Mutex<Vec<Cached>> = Mutex::new(Vec::new());
/// Maximum number of cached matchers; the least recently used one is dropped.
const MAX_CACHED: usize = 4;

struct Cached {
    parameters: [i32; 5],
    matcher: Mpv,
    disparity: Vec<u16>,
    confidence: Vec<u8>,
}

/// Matches one pair of `width` × `height` grey images for disparities below `disparities` and
/// writes disparities in pixels to `disparity`, −1 where unknown. Variant 0 is the fast search, 1 the full one.
/// Returns 0 on success.
///
/// # Safety
/// The images and the map must hold `width` × `height` values.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn peer_run(
    left: *const u8,
    right: *const u8,
    width: i32,
    height: i32,
    disparities: i32,
    variant: i32,
    threads: i32,
    disparity: *mut f32,
) -> i32 {
    let (Ok(w), Ok(h), Ok(d)) =
        (usize::try_from(width), usize::try_from(height), usize::try_from(disparities))
    else {
        return 1;
    };
    if Mpv::check(w, h, d).is_err() || left.is_null() || right.is_null() || disparity.is_null() {
        return 1;
    }
    // SAFETY: the pointers are not null, the size was checked, and the caller guarantees `w * h` values.
    let (left, right) =
        unsafe { (std::slice::from_raw_parts(left, w * h), std::slice::from_raw_parts(right, w * h)) };
    let (Ok(left), Ok(right)) = (GreyView::new(left, w, h, w), GreyView::new(right, w, h, w)) else {
        return 2;
    };
    let Ok(mut cached) = MATCHERS.lock() else { return 3 };
    let wanted = [width, height, disparities, variant, threads];
    match cached.iter().position(|cached| cached.parameters == wanted) {
        Some(place) => cached[place..].rotate_left(1),
        None => {
            let threads = usize::try_from(threads).unwrap_or(1).clamp(1, 64);
            let Ok(crew) = Crew::new(threads, |_| ()) else { return 4 };
            let search = if variant == 1 { Search::Full } else { Search::Windows };
            let named = std::env::var("LOOKOUT_LEVEL").ok().and_then(|name| Level::named(&name));
            let level = named.unwrap_or_else(Level::best);
            let Ok(matcher) = Mpv::with_crew(crew, level, MpvParameters::default(), search, w, h, d) else {
                return 4;
            };
            if cached.len() == MAX_CACHED {
                cached.remove(0);
            }
            let (disparity, confidence) = (vec![0; w * h], vec![0; w * h]);
            cached.push(Cached { parameters: wanted, matcher, disparity, confidence });
        }
    }
    let Some(Cached { matcher, disparity: map, confidence, .. }) = cached.last_mut() else { return 5 };
    let output = MatchOutput { disparity: map, confidence };
    if matcher.compute(left, right, output).is_err() {
        return 6;
    }
    for (i, &d) in map.iter().enumerate() {
        let value = if d == 0 { -1.0 } else { f32::from(d) / 256.0 };
        // SAFETY: the caller guarantees memory for `map.len()` values, which need not be initialised.
        unsafe { disparity.add(i).write(value) };
    }
    0
}
