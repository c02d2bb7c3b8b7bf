//! Output formats: images, plots, overlays, frame records and run summaries.

pub mod alarm_times;
pub mod colour;
pub mod fields;
pub mod html;
pub mod labels;
pub mod motion;
pub mod output;
pub mod overlay;
pub mod palette;
pub mod path;
pub mod picture;
pub mod plot;
pub mod ply;
pub mod poses;
pub mod record;
pub mod space;
pub mod summary;
pub mod svg;
pub mod tidy;
pub mod v_disparity;
pub mod video;
