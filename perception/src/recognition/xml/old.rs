//! Reads the format of Haar cascades before OpenCV 2.x: trees of nodes that contain their features.

use super::super::cascade::{Branch, Cascade, Features, HaarFeature, Node, Split, Stage};
use super::element::{CascadeError, child, haar_feature, items, number, numbers, side, single, value_error};
use roxmltree::Node as XmlNode;

pub(super) fn read(cascade: XmlNode<'_, '_>) -> Result<Cascade, CascadeError> {
    let size = child(cascade, "size")?;
    let [width, height] = numbers::<u16>(size)?[..] else {
        return Err(value_error(size, "two numbers: width height".into()));
    };
    let (width, height) = (side(size, Some(width), 3)?, side(size, Some(height), 3)?);
    let list = child(cascade, "stages")?;
    let mut features = Vec::new();
    let mut stages = Vec::new();
    for (i, element) in items(list).enumerate() {
        // Branching cascades are trees of stages; OpenCV reads them as a list, too.
        if let Some(parent) = element.children().find(|c| c.has_tag_name("parent"))
            && number::<i64>(parent)? != i as i64 - 1
        {
            return Err(value_error(
                parent,
                "only consecutive stages can be read; this cascade branches".into(),
            ));
        }
        let trees = child(element, "trees")?;
        let threshold = single(child(element, "stage_threshold")?)?;
        let trees_read = items(trees)
            .map(|tree| read_tree(tree, width, height, &mut features))
            .collect::<Result<Vec<_>, _>>()?;
        if trees_read.is_empty() {
            return Err(value_error(trees, "a stage has at least one tree".into()));
        }
        stages.push(Stage { threshold, trees: trees_read });
    }
    if stages.is_empty() {
        return Err(value_error(list, "a cascade has at least one stage".into()));
    }
    Ok(Cascade { width, height, features: Features::Haar(features), stages })
}

fn read_tree(
    element: XmlNode<'_, '_>,
    width: u16,
    height: u16,
    features: &mut Vec<HaarFeature>,
) -> Result<Vec<Node>, CascadeError> {
    let count = items(element).count();
    if count == 0 || count > usize::from(u16::MAX) / 2 {
        return Err(value_error(element, format!("{count} nodes, a tree has 1 to {}", u16::MAX / 2)));
    }
    let mut nodes = Vec::with_capacity(count);
    for (i, node) in items(element).enumerate() {
        let feature = features.len() as u32;
        features.push(haar_feature(child(node, "feature")?, width, height)?);
        let threshold = single(child(node, "threshold")?)?;
        let branch = |value: &'static str, next: &'static str| {
            if let Some(leaf) = node.children().find(|c| c.has_tag_name(value)) {
                return Ok(Branch::Leaf(single(leaf)?));
            }
            let element = child(node, next)?;
            match number::<u16>(element)? {
                n if usize::from(n) > i && usize::from(n) < count => Ok(Branch::Node(n)),
                _ => Err(value_error(element, format!("a node behind {i} and below {count}"))),
            }
        };
        let (left, right) = (branch("left_val", "left_node")?, branch("right_val", "right_node")?);
        nodes.push(Node { feature, split: Split::Threshold(threshold), left, right });
    }
    Ok(nodes)
}

#[cfg(test)]
mod tests {
    use super::super::read as read_text;
    use super::*;

    const OLD: &str = "<?xml version=\"1.0\"?>
<opencv_storage>
<face type_id=\"opencv-haar-classifier\">
  <size>20 22</size>
  <stages>
    <_>
      <trees>
        <_>
          <_>
            <feature><rects><_>3 7 14 4 -1.</_><_>3 9 14 2 2.</_></rects><tilted>0</tilted></feature>
            <threshold>4.01e-03</threshold>
            <left_val>0.25</left_val>
            <right_node>1</right_node></_>
          <_>
            <feature><rects><_>10 2 6 4 -1.</_><_>10 2 3 4 2.</_></rects><tilted>1</tilted></feature>
            <threshold>-0.5</threshold>
            <left_val>-1.</left_val>
            <right_val>0.75</right_val></_></_></trees>
      <stage_threshold>0.35</stage_threshold>
      <parent>-1</parent>
      <next>-1</next></_></stages></face></opencv_storage>";

    #[test]
    fn trees_are_read_as_written() {
        let cascade = read_text(OLD).unwrap();
        assert_eq!((cascade.width, cascade.height, cascade.features.len()), (20, 22, 2));
        let tree = &cascade.stages[0].trees[0];
        assert_eq!((tree[0].left, tree[0].right), (Branch::Leaf(0.25), Branch::Node(1)));
        assert_eq!((tree[1].split, tree[1].right), (Split::Threshold(-0.5), Branch::Leaf(0.75)));
        let Features::Haar(features) = &cascade.features else { panic!("{:?}", cascade.features) };
        assert!(features[1].tilted && !features[0].tilted);
        assert_eq!(features[0].rects().count(), 2);
    }

    #[test]
    fn errors_name_the_line() {
        for (from, to, expected) in [
            ("20 22", "20", "line 4: <size> is \"20\": two numbers"),
            ("20 22", "20 9999", "pixels a side"),
            ("3 7 14 4 -1.", "3 7 14 4", "line 10: <_> is \"3 7 14 4\": five numbers"),
            ("3 7 14 4 -1.", "3 7 18 4 -1.", "within the 20x22 window"),
            ("10 2 6 4 -1.", "3 2 6 4 -1.", "tilted rectangle"),
            ("10 2 6 4 -1.", "10 14 6 4 -1.", "tilted rectangle"),
            ("<right_node>1", "<right_node>0", "a node behind 0"),
            ("<right_node>1", "<right_node>2", "below 2"),
            ("<parent>-1", "<parent>3", "this cascade branches"),
            ("<threshold>-0.5</threshold>", "", "line 14: <threshold> is missing"),
            ("0.35", "inf", "finite"),
            ("4 2 2.", "4 2 0", "four"),
        ] {
            let (from, to, expected) = match expected {
                // A weight of 0 marks an unused rectangle.
                "four" => ("3 9 14 2 2.", "3 9 14 2 0.", "not 0"),
                _ => (from, to, expected),
            };
            assert!(OLD.contains(from), "{from}");
            let error = read_text(&OLD.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(expected), "{from} -> {to}: {error}");
        }
    }

    #[test]
    fn no_truncation_panics() {
        for end in 0..OLD.len() {
            assert!(read_text(&OLD[..end]).is_err());
        }
    }
}
