//! Places for the labels of boxes: none covers another, and what stands away from its box has a leader line.

/// Left, top, right and bottom of an area, in px; right and bottom are outside.
pub type Area = [i32; 4];

/// A box that wants a label.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wanted {
    /// The box.
    pub area: Area,
    /// The label, and a shorter one for where that has no room.
    pub texts: [String; 2],
}

/// A label with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placed {
    /// Index of its box.
    pub index: usize,
    /// The text.
    pub text: String,
    /// The area that it covers.
    pub area: Area,
    /// Ends of the line to its box, where it stands away from it.
    pub leader: Option<[(i32, i32); 2]>,
}

/// How labels are set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// Width of a character, in px.
    pub character: i32,
    /// Height of a line, in px.
    pub line: i32,
    /// Width and height of the picture, in px.
    pub size: (i32, i32),
    /// Edge of the picture that no label covers, in px.
    pub margin: i32,
}

/// Space between two labels, in px.
const GAP: i32 = 2;

/// Lines by which a label may be moved away from its box.
const MAX_STEPS: i32 = 4;

/// Places labels in the order of their boxes, the most important first; a label without room is left out. `taken` are
/// areas that none may cover.
pub fn place(wanted: &[Wanted], setting: Setting, taken: &[Area]) -> Vec<Placed> {
    let mut used = taken.to_vec();
    let mut placed = Vec::new();
    for (index, one) in wanted.iter().enumerate() {
        // The whole text at the box, then the short one there, then the short one with a line.
        let found = [(0, false), (1, false), (1, true)].into_iter().find_map(|(text, is_away)| {
            let text = &one.texts[text];
            let (area, leader) = room(one.area, text, setting, is_away, &used)?;
            Some(Placed { index, text: text.clone(), area, leader })
        });
        if let Some(found) = found {
            used.push(found.area);
            placed.push(found);
        }
    }
    placed
}

type Place = (Area, Option<[(i32, i32); 2]>);

/// The first free place for a text at its box, or, with `is_away`, above or below it.
fn room(around: Area, text: &str, setting: Setting, is_away: bool, used: &[Area]) -> Option<Place> {
    let [left, top, right, bottom] = around;
    let margin = setting.margin;
    let (width, height) = (setting.size.0 - margin, setting.size.1 - margin);
    let (long, line) = (text.chars().count() as i32 * setting.character + GAP, setting.line);
    if long > width - margin {
        return None;
    }
    let fits = |x: i32, y: i32| {
        let x = x.clamp(margin, width - long);
        let area = [x, y, x + long, y + line];
        let is_inside = y >= margin && y + line <= height;
        (is_inside && !used.iter().any(|other| overlap(*other, area))).then_some(area)
    };
    let at_box = [(left, top - line), (right - long, top - line), (left, bottom), (right - long, bottom)];
    if !is_away {
        return at_box.into_iter().find_map(|(x, y)| Some((fits(x, y)?, None)));
    }
    let middle = (left + right) / 2;
    (1..=MAX_STEPS).find_map(|step| {
        let away = step * (line + GAP);
        let above = || {
            let area = fits(middle - long / 2, top - line - away)?;
            Some((area, Some([(middle.clamp(area[0], area[2]), area[3]), (middle, top)])))
        };
        let below = || {
            let area = fits(middle - long / 2, bottom + away)?;
            Some((area, Some([(middle.clamp(area[0], area[2]), area[1]), (middle, bottom)])))
        };
        above().or_else(below)
    })
}

fn overlap(a: Area, b: Area) -> bool {
    a[0] < b[2] + GAP && b[0] < a[2] + GAP && a[1] < b[3] && b[1] < a[3]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTING: Setting = Setting { character: 7, line: 13, size: (640, 480), margin: 0 };

    fn wanted(area: Area) -> Wanted {
        Wanted { area, texts: ["vehicle 12.3+-0.4m".into(), "12m".into()] }
    }

    #[test]
    fn no_label_covers_another_and_those_that_are_away_have_a_line() {
        // A crowd in the distance: a hundred boxes, 2 px apart.
        let crowd: Vec<Wanted> = (0..100).map(|i| wanted([200 + 2 * i, 230, 220 + 2 * i, 250])).collect();
        let header = [0, 0, 640, 34];
        let placed = place(&crowd, SETTING, &[header]);
        assert!((10..100).contains(&placed.len()), "{}", placed.len());
        assert_eq!(placed[0].text, "vehicle 12.3+-0.4m", "the first has its whole text");
        for (i, one) in placed.iter().enumerate() {
            let [left, top, right, bottom] = one.area;
            assert!(left >= 0 && top >= 34 && right <= 640 && bottom <= 480, "{one:?}");
            assert!(placed[..i].iter().all(|other| !overlap(other.area, one.area)), "{one:?}");
            let [_, box_top, _, box_bottom] = crowd[one.index].area;
            let is_at_box = bottom == box_top || top == box_bottom;
            assert_eq!(one.leader.is_none(), is_at_box, "{one:?}");
        }
        assert!(placed.iter().any(|one| one.leader.is_some()));
    }

    #[test]
    fn labels_stay_in_the_picture_and_without_room_there_is_none() {
        let corner = place(&[wanted([630, 0, 640, 20])], SETTING, &[]);
        assert_eq!(corner[0].area[1..], [20, 640, 33], "below its box, moved to the left");
        assert_eq!(place(&[wanted([0, 0, 640, 480])], SETTING, &[]), []);
        let small = Setting { size: (20, 20), ..SETTING };
        assert_eq!(place(&[wanted([0, 0, 5, 5])], small, &[]), []);
        let framed = Setting { margin: 4, ..SETTING };
        let edges =
            [[0, 100, 10, 120], [630, 100, 640, 120], [300, 0, 340, 466], [300, 15, 340, 480]].map(wanted);
        for one in place(&edges, framed, &[]) {
            let [left, top, right, bottom] = one.area;
            assert!(left >= 4 && top >= 4 && right <= 636 && bottom <= 476, "{one:?}");
        }
        assert_eq!(
            place(&[wanted([0, 0, 5, 5])], Setting { size: (26, 40), ..framed }, &[]),
            [],
            "too narrow"
        );
    }
}
