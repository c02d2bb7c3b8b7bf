//! How long tracks live: the median by Kaplan and Meier, for which a track whose thing left the view tells only that it
//! lived at least so long.

/// Why nothing more was seen of a track.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum End {
    /// Its thing left what both cameras see, or the range, or the recording ended.
    #[default]
    Left,
    /// Something nearer hid it.
    Hidden,
    /// It is told as a part of a boundary from then on.
    Boundary,
    /// It was lost while its thing was to be seen.
    Lost,
}

/// Life of one track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Life {
    /// From its first confirmed frame to its last sighting, both included, in seconds.
    pub seconds: f64,
    /// Why it ended.
    pub end: End,
}

impl Life {
    /// Whether its thing was in view when it ended.
    pub fn is_lost(&self) -> bool {
        self.end == End::Lost
    }

    /// The same where what is hidden, or is now told as a boundary, counts as lost, too.
    pub fn is_lost_strictly(&self) -> bool {
        self.end != End::Left
    }
}

/// Time after which half of the tracks are lost, in seconds, and whether that is only a lower limit, because fewer than half
/// were lost: then it is the longest life. `None` without tracks.
pub fn median_life(lives: &[Life], is_lost: impl Fn(&Life) -> bool) -> Option<(f64, bool)> {
    let mut sorted = lives.to_vec();
    // Of two equal lives the lost one counts first.
    sorted.sort_by(|a, b| a.seconds.total_cmp(&b.seconds).then(is_lost(b).cmp(&is_lost(a))));
    let mut alive = 1.0;
    for (i, life) in sorted.iter().enumerate() {
        if is_lost(life) {
            let at_risk = (sorted.len() - i) as f64;
            alive *= 1.0 - 1.0 / at_risk;
        }
        if alive <= 0.5 + 1e-9 {
            return Some((life.seconds, false));
        }
    }
    Some((sorted.last()?.seconds, true))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lives(all: &[(f64, bool)]) -> Vec<Life> {
        all.iter()
            .map(|&(seconds, is_lost)| Life { seconds, end: if is_lost { End::Lost } else { End::Left } })
            .collect()
    }

    fn median_life(lives: &[Life]) -> Option<(f64, bool)> {
        super::median_life(lives, Life::is_lost)
    }

    #[test]
    fn half_of_the_tracks_are_lost_by_the_median() {
        assert_eq!(median_life(&[]), None);
        assert_eq!(median_life(&lives(&[(2.0, true)])), Some((2.0, false)));
        assert_eq!(median_life(&lives(&[(3.0, true), (1.0, true), (2.0, true)])), Some((2.0, false)));
        // What left early says nothing of the time after: of the two that remain one is lost at 3 s.
        let left = lives(&[(0.5, false), (0.6, false), (3.0, true), (5.0, true)]);
        assert_eq!(median_life(&left), Some((3.0, false)));
        // A textbook case: losses at 1 (of 5), 3 (of 3) and 4 (of 2): 0.8, 0.53, 0.27.
        let some = lives(&[(1.0, true), (2.0, false), (3.0, true), (4.0, true), (6.0, false)]);
        assert_eq!(median_life(&some), Some((4.0, false)));
        // Fewer than half are lost.
        let most = lives(&[(1.0, true), (2.0, false), (7.0, false)]);
        assert_eq!(median_life(&most), Some((7.0, true)));
    }
    #[test]
    fn what_is_hidden_is_lost_only_by_the_stricter_rule() {
        let life = |seconds, end| Life { seconds, end };
        let some = [life(1.0, End::Hidden), life(2.0, End::Lost), life(3.0, End::Lost), life(4.0, End::Left)];
        assert_eq!(median_life(&some), Some((3.0, false)));
        assert_eq!(super::median_life(&some, Life::is_lost_strictly), Some((2.0, false)));
    }
}
