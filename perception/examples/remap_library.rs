//! Remapping as a shared library, for benchmarks against other implementations. Build with
//! `cargo build --release -p lookout-perception --example remap_library`.

use lookout_perception::image::GreyView;
use lookout_perception::rectify::Remap;
use lookout_perception::simd::Level;
use std::sync::Mutex;

static TABLE: Mutex<Option<Remap>> = Mutex::new(None);

/// Creates the table in which output pixel (x, y) shows the source position (`xs`, `ys`)[y · `width` + x]. Returns
/// its size in bytes, or −1 on error.
///
/// # Safety
/// The maps must hold `width` × `height` values.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn remap_make(xs: *const f32, ys: *const f32, width: i32, height: i32) -> i64 {
    let (Ok(w), Ok(h)) = (usize::try_from(width), usize::try_from(height)) else { return -1 };
    if xs.is_null() || ys.is_null() || w == 0 || h == 0 {
        return -1;
    }
    // SAFETY: the pointers are not null, and the caller guarantees `w * h` values.
    let (xs, ys) = unsafe { (std::slice::from_raw_parts(xs, w * h), std::slice::from_raw_parts(ys, w * h)) };
    let position = |x: usize, y: usize| Some((f64::from(xs[y * w + x]), f64::from(ys[y * w + x])));
    let table = Remap::new(Level::best(), w, h, position);
    let bytes = i64::try_from(table.bytes()).unwrap_or(-1);
    match TABLE.lock() {
        Ok(mut kept) => *kept = Some(table),
        Err(_) => return -1,
    }
    bytes
}

/// Remaps an image with the last created table. Returns 0 on success.
///
/// # Safety
/// Both images must hold width × height bytes of the table's size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn remap_run(source: *const u8, out: *mut u8) -> i32 {
    let Ok(kept) = TABLE.lock() else { return 1 };
    let Some(table) = kept.as_ref() else { return 2 };
    if source.is_null() || out.is_null() {
        return 3;
    }
    let (w, h) = table.size();
    // SAFETY: the pointers are not null, and the caller guarantees `w * h` bytes.
    let (source, out) =
        unsafe { (std::slice::from_raw_parts(source, w * h), std::slice::from_raw_parts_mut(out, w * h)) };
    let Ok(view) = GreyView::new(source, w, h, w) else { return 4 };
    i32::from(table.apply(view, out).is_err())
}
