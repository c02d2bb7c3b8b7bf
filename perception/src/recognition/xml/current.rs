//! Reads the format of OpenCV's trainer since 2.x.

use super::super::cascade::{Branch, Cascade, Features, LbpFeature, Node, Split, Stage};
use super::element::{CascadeError, child, haar_feature, items, number, numbers, side, single, value_error};
use roxmltree::Node as XmlNode;

pub(super) fn read(cascade: XmlNode<'_, '_>) -> Result<Cascade, CascadeError> {
    let stage_type = child(cascade, "stageType")?;
    if text(stage_type) != "BOOST" {
        return Err(value_error(stage_type, "only boosted cascades (BOOST) can be read".into()));
    }
    let kind = child(cascade, "featureType")?;
    let haar = match text(kind) {
        "LBP" => false,
        "HAAR" => true,
        _ => {
            return Err(value_error(
                kind,
                "only LBP and HAAR can be read; retrain the cascade with one of them".into(),
            ));
        }
    };
    let window = |name| {
        let element = child(cascade, name)?;
        side(element, number(element).ok(), 3)
    };
    let (width, height) = (number_first(cascade, "width").and_then(|()| window("width"))?, window("height")?);
    let list = child(cascade, "features")?;
    let features = if haar {
        Features::Haar(items(list).map(|f| haar_feature(f, width, height)).collect::<Result<_, _>>()?)
    } else {
        Features::Lbp(items(list).map(|f| lbp_feature(f, width, height)).collect::<Result<_, _>>()?)
    };
    let stages_element = child(cascade, "stages")?;
    let stages =
        items(stages_element).map(|s| stage(s, features.len(), haar)).collect::<Result<Vec<_>, _>>()?;
    if stages.is_empty() {
        return Err(value_error(stages_element, "a cascade has at least one stage".into()));
    }
    Ok(Cascade { width, height, features, stages })
}

fn text<'a>(element: XmlNode<'a, '_>) -> &'a str {
    element.text().unwrap_or("").trim()
}

/// Reports a text that is not a number before its range is checked.
fn number_first(cascade: XmlNode<'_, '_>, name: &'static str) -> Result<(), CascadeError> {
    number::<f64>(child(cascade, name)?).map(|_| ())
}

fn lbp_feature(element: XmlNode<'_, '_>, width: u16, height: u16) -> Result<LbpFeature, CascadeError> {
    let rect = child(element, "rect")?;
    let [x, y, w, h] = numbers::<u16>(rect)?[..] else {
        return Err(value_error(rect, "four numbers: x y width height of the first block".into()));
    };
    let fits = |start: u16, block: u16, side: u16| {
        block > 0 && u32::from(start) + 3 * u32::from(block) <= u32::from(side)
    };
    if !fits(x, w, width) || !fits(y, h, height) {
        return Err(value_error(rect, format!("its 3x3 blocks must lie within the {width}x{height} window")));
    }
    Ok(LbpFeature { x, y, width: w, height: h })
}

fn stage(element: XmlNode<'_, '_>, features: usize, haar: bool) -> Result<Stage, CascadeError> {
    let threshold = single(child(element, "stageThreshold")?)?;
    let weak = child(element, "weakClassifiers")?;
    let trees = items(weak).map(|t| tree(t, features, haar)).collect::<Result<Vec<_>, _>>()?;
    if trees.is_empty() {
        return Err(value_error(weak, "a stage has at least one tree".into()));
    }
    Ok(Stage { threshold, trees })
}

fn tree(element: XmlNode<'_, '_>, features: usize, haar: bool) -> Result<Vec<Node>, CascadeError> {
    let row_length = if haar { 4 } else { 3 + 8 };
    let leaves_element = child(element, "leafValues")?;
    let leaves: Vec<f32> = numbers::<f64>(leaves_element)?.into_iter().map(|v| v as f32).collect();
    if let Some(bad) = leaves.iter().find(|v| !v.is_finite()) {
        return Err(value_error(leaves_element, format!("{bad} is not a finite number")));
    }
    let nodes_element = child(element, "internalNodes")?;
    let values = numbers::<f64>(nodes_element)?;
    let error = |expected| Err(value_error(nodes_element, expected));
    if values.is_empty() || values.len() % row_length != 0 {
        let row = if haar {
            "a Haar node has 4: left right feature threshold"
        } else {
            "an LBP node has 11: left right feature and 8 words"
        };
        return error(format!("{} numbers, {row}", values.len()));
    }
    let count = values.len() / row_length;
    if count > usize::from(u16::MAX) / 2 {
        return error(format!("{count} nodes, a tree has at most {}", u16::MAX / 2));
    }
    let mut nodes = Vec::with_capacity(count);
    for (i, row) in values.chunks_exact(row_length).enumerate() {
        let branch = |child: f64| {
            if child.fract() != 0.0 {
                None
            } else if child > 0.0 {
                // Children follow their parents, so evaluation always ends.
                let there = child > i as f64 && child < count as f64;
                there.then_some(Branch::Node(child as u16))
            } else {
                leaves.get(-child as usize).map(|&v| Branch::Leaf(v))
            }
        };
        let (Some(left), Some(right)) = (branch(row[0]), branch(row[1])) else {
            return error(format!("node {i} leads to {} and {}, which do not exist", row[0], row[1]));
        };
        if row[2].fract() != 0.0 || row[2] < 0.0 || row[2] >= features as f64 {
            return error(format!("node {i} refers to feature {} of {features}", row[2]));
        }
        let split = if haar {
            let threshold = row[3] as f32;
            if !threshold.is_finite() {
                return error(format!("node {i}: its threshold is not a finite number"));
            }
            Split::Threshold(threshold)
        } else {
            let mut subset = [0; 8];
            for (word, &value) in subset.iter_mut().zip(&row[3..]) {
                // Written as signed, but some writers give unsigned words.
                let range = f64::from(i32::MIN)..=f64::from(u32::MAX);
                if value.fract() != 0.0 || !range.contains(&value) {
                    return error(format!("{value} is not a 32-bit word"));
                }
                *word = value as i64 as u32;
            }
            Split::Subset(subset)
        };
        nodes.push(Node { feature: row[2] as u32, split, left, right });
    }
    Ok(nodes)
}
