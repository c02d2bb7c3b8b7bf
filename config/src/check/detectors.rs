//! The check of `[[recognition.detectors]]`.

use super::Checker;
use crate::keys::{self, Key};
use crate::tables::Config;
use toml::Spanned;
use toml::de::DeValue;

impl Checker<'_> {
    /// Checks a list of at most `most` tables with the keys of `recognition.detectors`.
    pub(super) fn detectors(&mut self, key: &Key, most: usize, value: &Spanned<DeValue<'_>>) {
        let tables: Option<Vec<_>> = value.get_ref().as_array().and_then(|list| {
            list.iter().map(|table| table.get_ref().as_table().map(|keys| (table.span(), keys))).collect()
        });
        let Some(tables) = tables.filter(|tables| tables.len() <= most) else {
            let text = format!("{}: give {}", key.path(), key.kind);
            return self.add(Some(value.span().start), text);
        };
        for (place, table) in tables {
            for (name, value) in table {
                if let Some(key) = keys::detectors().iter().find(|key| key.name == name.get_ref().as_ref()) {
                    self.value(key, value);
                } else {
                    let known = || keys::detectors().iter().map(|key| &key.name[..]);
                    self.unknown(name, &format!("key {}.", key.path()), "", known);
                }
            }
            // The default model is no cascade, and no other model knows people by the default's size.
            if table.contains_key("kind") && !table.contains_key("model") {
                let text = format!("{}: name the file of the model, as model = \"FILE\"", key.path());
                self.add(Some(place.start), text);
            }
        }
    }

    /// Checks that the sizes of each detector are in order; `offset` is where the file names detectors.
    pub(super) fn detector_sizes(&mut self, c: &Config, offset: Option<usize>) {
        for d in &c.recognition.detectors {
            let sizes = [("width", d.width_min_m, d.width_max_m), ("height", d.height_min_m, d.height_max_m)];
            for (side, low, high) in sizes.into_iter().filter(|(_, low, high)| low > high) {
                let text = format!(
                    "recognition.detectors: {side}_min_m = {low} is too high: at most {high}, because of \
                     {side}_max_m of \"{}\"",
                    d.label
                );
                self.add(offset, text);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::parse;
    use std::path::Path;

    fn errors(text: &str) -> Vec<String> {
        parse(text, Path::new("car.toml")).unwrap_err().0.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn detectors_find_people_where_they_name_nothing_else() {
        let detectors = |text: &str| parse(text, Path::new("x")).unwrap().recognition.detectors;
        assert!(detectors("").is_empty());
        let people = detectors("[[recognition.detectors]]\n");
        assert_eq!((people.len(), &people[0].label[..]), (1, "pedestrian"));
        assert!(detectors("[recognition]\ndetectors = []\n").is_empty());
        let text = "[[recognition.detectors]]\nlabel = \"adult\"\n\
                    [[recognition.detectors]]\nkind = \"cascade\"\nmodel = \"vehicle\"\nlooks_max = 2\n";
        let two = detectors(text);
        assert_eq!(
            (&two[0].label[..], &two[0].kind[..], two[0].window_m),
            ("adult", "hog", people[0].window_m)
        );
        assert_eq!((&two[1].kind[..], two[1].looks_max), ("cascade", 2));
        // The keys of the first detector stay beside them.
        let both = format!("[recognition]\nlabel = \"car\"\n{text}");
        assert_eq!(parse(&both, Path::new("x")).unwrap().recognition.label, "car");
    }

    #[test]
    fn what_is_wrong_in_a_detector_is_told_with_its_line() {
        let text = "[[recognition.detectors]]\nkind = \"hogg\"\nwindow_m = 0\ntreshold = 1\n\
                    [[recognition.detectors]]\nwidth_min_m = 3\n";
        let got = errors(text);
        for (line, part) in [
            (1, "recognition.detectors: name the file of the model"),
            (2, "recognition.detectors.kind = \"hogg\": give one of \"hog\", \"cascade\""),
            (3, "recognition.detectors.window_m = 0: give a number from 0.05"),
            (4, "unknown key recognition.detectors.treshold; did you mean recognition.detectors.threshold?"),
        ] {
            let expected = format!("car.toml:{line}: {part}");
            assert!(got.iter().any(|e| e.starts_with(&expected)), "{expected}\nin {got:#?}");
        }
        assert_eq!(got.len(), 4, "{got:#?}");
        let crossed = errors("[[recognition.detectors]]\nwidth_min_m = 3\n");
        assert!(crossed[0].contains("width_min_m = 3 is too high: at most 1.5"), "{crossed:?}");
        for list in ["3", "[1]", "[{}, {}, {}, {}, {}, {}, {}, {}, {}]"] {
            let wrong = errors(&format!("[recognition]\ndetectors = {list}\n"));
            assert!(
                wrong[0].starts_with("car.toml:2: recognition.detectors: give at most 8 tables"),
                "{wrong:?}"
            );
        }
    }
}
