//! Parts of HTML pages that need no other file: text, style, pictures as data.

use crate::reporting::picture::Picture;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{FilterType, resize};
use image::{ExtendedColorType, ImageEncoder, RgbImage};

/// JPEG quality of pictures in a page: boxes and text stay readable.
const JPEG_QUALITY: u8 = 72;

/// Text with the characters escaped that have a meaning in HTML.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A page with a title and this body.
pub fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{}</title>\
         <style>body{{font:15px/1.5 sans-serif;max-width:110em;margin:2em auto;padding:0 1em;background:#fafafa}}\
         img,svg{{max-width:100%}}table{{border-collapse:collapse}}td,th{{padding:.15em .8em;text-align:right;\
         border-bottom:1px solid #ddd}}td:first-child,th:first-child{{text-align:left}}\
         .strip{{display:grid;grid-template-columns:repeat(3,1fr);gap:.4em}}.strip figure{{margin:0}}\
         figcaption{{font-size:.85em;color:#444}}</style>\n{body}</html>\n",
        escaped(title)
    )
}

/// The value of `src` for a picture as JPEG, at most `max_width` px wide; empty if JPEG does not support its size.
pub fn picture_source(picture: &Picture, max_width: usize) -> String {
    let size = |side: usize| u32::try_from(side).unwrap_or(0);
    let (width, height) = (size(picture.width()), size(picture.height()));
    let Some(image) = RgbImage::from_raw(width, height, picture.as_bytes().to_vec()) else {
        return String::new();
    };
    let image = match size(max_width) {
        narrow if narrow < width => {
            let low = (u64::from(height) * u64::from(narrow) / u64::from(width)).max(1);
            resize(&image, narrow, u32::try_from(low).unwrap_or(1), FilterType::Triangle)
        }
        _ => image,
    };
    let mut bytes = Vec::with_capacity(image.as_raw().len() / 8);
    let written = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).write_image(
        image.as_raw(),
        image.width(),
        image.height(),
        ExtendedColorType::Rgb8,
    );
    if written.is_ok() { format!("data:image/jpeg;base64,{}", base64(&bytes)) } else { String::new() }
}

/// Base64 with padding (RFC 4648, section 4).
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let three =
            chunk.iter().fold(0_u32, |all, &byte| all << 8 | u32::from(byte)) << (8 * (3 - chunk.len()));
        for digit in 0..4 {
            let index = (three >> (18 - 6 * digit) & 63) as usize;
            text.push(if digit <= chunk.len() { DIGITS[index] as char } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        let all = ["", "f", "fo", "foo", "foob", "fooba", "foobar"].map(|text| base64(text.as_bytes()));
        assert_eq!(all, ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"]);
        assert_eq!(base64(&[0xFB, 0xFF]), "+/8=");
    }

    #[test]
    fn a_wide_picture_is_reduced_and_a_page_needs_nothing_else() {
        let picture = Picture::new(300, 100, [200, 20, 20]);
        let source = picture_source(&picture, 150);
        assert!(source.starts_with("data:image/jpeg;base64,/9j/"), "{source}");
        assert!(source.len() < picture_source(&picture, 300).len());
        let text = page("a < b", "<h1>c</h1>");
        assert!(text.contains("<title>a &lt; b</title>") && text.ends_with("<h1>c</h1></html>\n"), "{text}");
        assert!(!text.contains("http"), "nothing is fetched");
    }
}
