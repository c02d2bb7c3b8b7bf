//! Dense stereo matching: computes a disparity map with confidence from a rectified image pair.
//!
//! Input are two rectified 8-bit grey images of the same size ([`GreyView`](crate::image::GreyView)). Output is, for
//! each pixel of the left image, a disparity in 1/256 px (0 = unknown) and a confidence from 1 to 255 (0 where
//! the disparity is unknown); see [`MatchOutput`]. A point at disparity d pixels has the depth
//! focal length · baseline / d. [`Matcher`] is the interface; [`Mpv`] implements it on the CPU, and `gpu::GpuMpv`
//! (feature `gpu`) on Vulkan devices with bit-identical results.
//!
//! The algorithm is Multi-Path-Viterbi (paper, sections 3.2 to 3.4):
//!
//! | step | module | paper |
//! |---|---|---|
//! | image pyramid | [`pyramid`] | 3.4 |
//! | search windows and slopes from the coarser scale | [`blocks`] | 3.4 |
//! | matching cost: SSIM and gradient | [`cost`] | 3.2 |
//! | Viterbi paths with total-variation edge cost | [`viterbi`], [`solver`] | 3.2, 3.3 |
//! | winner-take-all, sub-pixel refinement, left-right check | [`winner`] | |
//! | confidence, median, speckle filter, hole filling | [`confidence`], [`median`], [`speckle`], [`fill`] | |
//!
//! [`epipolar`] monitors the epipolar alignment of the pair.
//!
//! # Example
//!
//! Match a synthetic pair whose right image is shifted by 5 pixels:
//!
//! ```
//! use lookout_perception::image::GreyImage;
//! use lookout_perception::stereo::{DisparityView, MatchOutput, Matcher, Mpv, MpvParameters, Search};
//!
//! let (width, height, shift) = (96, 48, 5);
//! let texture = |x: usize, y: usize| ((x * x + 3 * y * y + 7 * x * y) * 13 / 16 % 251) as u8;
//! let (mut left, mut right) = (GreyImage::new(width, height), GreyImage::new(width, height));
//! for y in 0..height {
//!     for x in 0..width {
//!         left.as_mut_slice()[y * width + x] = texture(x, y);
//!         right.as_mut_slice()[y * width + x] = texture(x + shift, y);
//!     }
//! }
//!
//! // Disparities 0 to 15; `Search::Full` searches all of them at the finest scale.
//! let mut matcher = Mpv::new(MpvParameters::default(), Search::Full, width, height, 16)?;
//! let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
//! let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
//! matcher.compute(left.view(), right.view(), output)?;
//!
//! let map = DisparityView::new(&disparity, width, height).expect("the sizes match");
//! let centre = f32::from(map.row(24)[48]) / 256.0;
//! assert!((centre - 5.0).abs() < 0.25, "{centre} px");
//! assert!(confidence[24 * width + 48] > 100);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod blocks;
pub mod confidence;
pub mod cost;
pub mod crew;
pub mod device;
mod disparity;
pub mod energy;
pub mod epipolar;
pub mod fallback;
pub mod fill;
#[cfg(feature = "gpu")]
pub mod gpu;
mod matcher;
pub mod median;
pub mod mpv;
pub mod pyramid;
pub mod reliability;
pub mod scale;
pub mod solver;
pub mod speckle;
pub mod viterbi;
pub mod winner;
mod worker;

pub use crew::{Crew, CrewError};
pub use disparity::DisparityView;
pub use matcher::{MatchError, MatchOutput, Matcher, MatcherError};
pub use mpv::{Mpv, MpvParameters, Search};
