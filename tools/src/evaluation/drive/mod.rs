//! A drive without labels, judged by the strip that the vehicle then drove through: nothing was hit, so whatever was
//! reported inside that strip was not there.
//!
//! Input: the record of each frame, and where the vehicle was at each frame ([`strip::DrivenPath`]). Output: a
//! [`score::DriveScore`] with the false obstacles, the alarm's levels, and how steady tracks and boxes are.

pub mod driven_ground;
pub mod event;
pub mod filmstrip;
pub mod life;
pub mod page;
pub mod report;
pub mod score;
pub mod steadiness;
pub mod strip;
