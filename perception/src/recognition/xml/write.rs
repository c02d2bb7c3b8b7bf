//! Writes the format of OpenCV's trainer.

use super::super::cascade::{Branch, Cascade, Features, Node, Split, WeightedRect};
use std::fmt::Write;

/// Training parameters; stored in the file, not needed for detection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainedWith {
    /// Minimum hit rate of each stage.
    pub hit_rate: f64,
    /// Maximum false-alarm rate of each stage.
    pub false_alarm_rate: f64,
    /// Maximum depth of a tree.
    pub max_depth: u32,
    /// Maximum number of trees in a stage.
    pub max_trees: u32,
}

/// The text of the cascade's XML file. Numbers are written so that they are read back exactly; unused features
/// are omitted.
pub fn write(cascade: &Cascade, trained: &TrainedWith) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = write_to(&mut out, cascade, trained);
    out
}

fn write_to(out: &mut String, cascade: &Cascade, trained: &TrainedWith) -> std::fmt::Result {
    let (kind, categories) = match cascade.features {
        Features::Lbp(_) => ("LBP", 256),
        Features::Haar(_) => ("HAAR", 0),
    };
    let indices = feature_indices(cascade);
    writeln!(out, "<?xml version=\"1.0\"?>\n<opencv_storage>\n<cascade>")?;
    writeln!(out, "  <stageType>BOOST</stageType>\n  <featureType>{kind}</featureType>")?;
    writeln!(out, "  <height>{}</height>\n  <width>{}</width>", cascade.height, cascade.width)?;
    writeln!(out, "  <stageParams>\n    <boostType>GAB</boostType>")?;
    writeln!(out, "    <minHitRate>{:e}</minHitRate>", trained.hit_rate)?;
    writeln!(out, "    <maxFalseAlarm>{:e}</maxFalseAlarm>", trained.false_alarm_rate)?;
    writeln!(out, "    <weightTrimRate>0.</weightTrimRate>\n    <maxDepth>{}</maxDepth>", trained.max_depth)?;
    writeln!(out, "    <maxWeakCount>{}</maxWeakCount></stageParams>", trained.max_trees)?;
    writeln!(out, "  <featureParams>\n    <maxCatCount>{categories}</maxCatCount>")?;
    writeln!(out, "    <featSize>1</featSize>")?;
    if categories == 0 {
        writeln!(out, "    <mode>ALL</mode>")?;
    }
    writeln!(out, "    </featureParams>\n  <stageNum>{}</stageNum>\n  <stages>", cascade.stages.len())?;
    for (i, stage) in cascade.stages.iter().enumerate() {
        writeln!(out, "    <!-- stage {i} -->\n    <_>")?;
        writeln!(out, "      <maxWeakCount>{}</maxWeakCount>", stage.trees.len())?;
        writeln!(out, "      <stageThreshold>{:e}</stageThreshold>", stage.threshold)?;
        writeln!(out, "      <weakClassifiers>")?;
        for (t, tree) in stage.trees.iter().enumerate() {
            write_tree(out, tree, &indices)?;
            let end = if t + 1 == stage.trees.len() { "</weakClassifiers></_>" } else { "" };
            writeln!(out, "{end}")?;
        }
    }
    writeln!(out, "  </stages>\n  <features>")?;
    match &cascade.features {
        Features::Lbp(features) => {
            for (f, _) in features.iter().zip(&indices).filter(|(_, index)| index.is_some()) {
                writeln!(out, "    <_><rect>{} {} {} {}</rect></_>", f.x, f.y, f.width, f.height)?;
            }
        }
        Features::Haar(features) => {
            for (f, _) in features.iter().zip(&indices).filter(|(_, index)| index.is_some()) {
                writeln!(out, "    <_>\n      <rects>")?;
                for WeightedRect { x, y, width, height, weight } in f.rects() {
                    writeln!(out, "        <_>{x} {y} {width} {height} {weight:e}</_>")?;
                }
                writeln!(out, "      </rects>\n      <tilted>{}</tilted></_>", u8::from(f.tilted))?;
            }
        }
    }
    writeln!(out, "  </features></cascade>\n</opencv_storage>")
}

/// The index of each feature in the file; `None` for unused features.
fn feature_indices(cascade: &Cascade) -> Vec<Option<usize>> {
    let mut indices = vec![None; cascade.features.len()];
    for node in cascade.stages.iter().flat_map(|s| &s.trees).flatten() {
        indices[node.feature as usize] = Some(0);
    }
    for (i, index) in indices.iter_mut().filter(|index| index.is_some()).enumerate() {
        *index = Some(i);
    }
    indices
}

fn write_tree(out: &mut String, tree: &[Node], indices: &[Option<usize>]) -> std::fmt::Result {
    let mut leaves = Vec::new();
    writeln!(out, "        <_>\n          <internalNodes>")?;
    for (i, node) in tree.iter().enumerate() {
        write!(out, "            ")?;
        for branch in [node.left, node.right] {
            match branch {
                Branch::Node(n) => write!(out, "{n} ")?,
                Branch::Leaf(value) => {
                    write!(out, "{} ", -(leaves.len() as i64))?;
                    leaves.push(value);
                }
            }
        }
        write!(out, "{}", indices[node.feature as usize].unwrap_or(0))?;
        match node.split {
            Split::Subset(words) => {
                for word in words {
                    write!(out, " {}", word as i32)?;
                }
            }
            Split::Threshold(threshold) => write!(out, " {threshold:e}")?,
        }
        writeln!(out, "{}", if i + 1 == tree.len() { "</internalNodes>" } else { "" })?;
    }
    write!(out, "          <leafValues>\n           ")?;
    for leaf in leaves {
        write!(out, " {leaf:e}")?;
    }
    write!(out, "</leafValues></_>")
}

#[cfg(test)]
mod tests {
    use super::super::super::cascade::{HaarFeature, LbpFeature, Stage};
    use super::super::read;
    use super::*;

    const TRAINED: TrainedWith =
        TrainedWith { hit_rate: 0.995, false_alarm_rate: 0.5, max_depth: 3, max_trees: 100 };

    fn cascade(features: Features, splits: [Split; 3]) -> Cascade {
        let node = |feature, split, left, right| Node { feature, split, left, right };
        let leaf = Branch::Leaf;
        let deep = vec![
            node(2, splits[0], Branch::Node(1), leaf(0.1)),
            node(0, splits[1], leaf(-1.0 / 3.0), Branch::Node(2)),
            node(2, splits[2], leaf(1e-9), leaf(-0.75)),
        ];
        let stump = vec![node(0, splits[2], leaf(0.5), leaf(-0.5))];
        let stages = vec![
            Stage { threshold: -0.123_456_79, trees: vec![stump.clone(), deep.clone()] },
            Stage { threshold: 1.5, trees: vec![deep, stump] },
        ];
        Cascade { width: 24, height: 20, features, stages }
    }

    #[test]
    fn what_is_written_is_read_back_bit_for_bit() {
        let lbp = |x| LbpFeature { x, y: 1, width: 4, height: 5 };
        let subset =
            |seed: u32| Split::Subset(std::array::from_fn(|i| seed.wrapping_mul(2_654_435_761 + i as u32)));
        let written =
            cascade(Features::Lbp(vec![lbp(1), lbp(2), lbp(3)]), [subset(1), subset(7), subset(u32::MAX)]);
        let mut expected = written.clone();
        // The unused feature is omitted.
        expected.features = Features::Lbp(vec![lbp(1), lbp(3)]);
        for node in expected.stages.iter_mut().flat_map(|s| &mut s.trees).flatten() {
            node.feature /= 2;
        }
        assert_eq!(read(&write(&written, &TRAINED)).unwrap(), expected);

        let rect = |x, weight| WeightedRect { x, y: 2, width: 6, height: 3, weight };
        let haar =
            |x, tilted| HaarFeature { rects: [rect(x, -1.0), rect(x, 2.5), WeightedRect::default()], tilted };
        let features = Features::Haar(vec![haar(4, true), haar(1, false), haar(9, false)]);
        let splits = [0.1_f32, -3e-5, f32::MIN_POSITIVE].map(Split::Threshold);
        let written = cascade(features, splits);
        expected.features = Features::Haar(vec![haar(4, true), haar(9, false)]);
        for (node, source) in expected
            .stages
            .iter_mut()
            .flat_map(|s| &mut s.trees)
            .flatten()
            .zip(written.stages.iter().flat_map(|s| &s.trees).flatten())
        {
            node.split = source.split;
        }
        assert_eq!(read(&write(&written, &TRAINED)).unwrap(), expected);
    }
}
