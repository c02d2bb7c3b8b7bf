use super::*;
use crate::image::GreyImage;
use crate::recognition::network::NetworkRecogniser;
use crate::recognition::network::sample::Rectangle;
use crate::simd::Level;

fn tensor(name: &str, dims: &[i64], values: Vec<f32>) -> Tensor {
    Tensor {
        name: name.into(),
        dims: dims.to_vec(),
        data_type: onnx::FLOAT,
        float_data: values,
        ..Tensor::default()
    }
}

fn ints(name: &str, ints: &[i64]) -> onnx::Attribute {
    onnx::Attribute { name: name.into(), ints: ints.to_vec(), ..onnx::Attribute::default() }
}

fn int(name: &str, i: i64) -> onnx::Attribute {
    onnx::Attribute { name: name.into(), i, ..onnx::Attribute::default() }
}

fn node(op_type: &str, input: &[&str], output: &str, attribute: Vec<onnx::Attribute>) -> Node {
    Node {
        op_type: op_type.into(),
        input: input.iter().map(|name| (*name).into()).collect(),
        output: vec![output.into()],
        attribute,
    }
}

fn value(name: &str, sides: &[i64]) -> onnx::ValueInfo {
    let dim = sides.iter().map(|&dim_value| onnx::Dimension { dim_value }).collect();
    let tensor_type = onnx::TensorType { elem_type: onnx::FLOAT, shape: Some(onnx::Shape { dim }) };
    onnx::ValueInfo { name: name.into(), r#type: Some(onnx::Type { tensor_type: Some(tensor_type) }) }
}

/// A network that tells whether the left half is brighter than the right, after two layers that change nothing.
fn model() -> onnx::Model {
    let weights = (0..2 * 64).map(|i| if (i % 8 < 4) == (i < 64) { 1.0 } else { 0.0 }).collect();
    let graph = onnx::Graph {
        node: vec![
            node("Conv", &["in", "w1"], "a", vec![ints("pads", &[1, 1, 1, 1])]),
            node("Identity", &["a"], "b", Vec::new()),
            node("MaxPool", &["b"], "c", vec![ints("kernel_shape", &[1, 1])]),
            node("Clip", &["c", "low", "high"], "d", Vec::new()),
            node("Flatten", &["d"], "e", Vec::new()),
            node("Gemm", &["e", "w2", "b2"], "f", vec![int("transB", 1)]),
            node("Softmax", &["f"], "out", Vec::new()),
        ],
        initializer: vec![
            tensor("w1", &[1, 1, 3, 3], vec![0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
            tensor("low", &[], vec![-100.0]),
            tensor("high", &[], vec![100.0]),
            tensor("w2", &[2, 64], weights),
            tensor("b2", &[2], vec![0.0, 0.25]),
        ],
        input: vec![value("in", &[0, 1, 8, 8])],
        output: vec![value("out", &[0, 2])],
    };
    let property = |key: &str, value: &str| onnx::Property { key: key.into(), value: value.into() };
    onnx::Model {
        opset_import: vec![onnx::OperatorSet { domain: String::new(), version: 17 }],
        graph: Some(graph),
        metadata_props: vec![
            property("labels", "left, other"),
            property("margin", "0"),
            property("sizes", "left 2 0.25 4.5 0.5"),
        ],
    }
}

fn changed(change: impl FnOnce(&mut onnx::Model)) -> String {
    let mut model = model();
    change(&mut model);
    Network::read(&model.encode_to_vec()).err().map_or_else(String::new, |e| e.to_string())
}

/// The error of the model with a changed graph.
fn with_graph(change: impl FnOnce(&mut onnx::Graph)) -> String {
    changed(|model| change(model.graph.as_mut().unwrap()))
}

#[test]
fn a_network_is_read_and_computed() {
    let network = Network::read(&model().encode_to_vec()).unwrap();
    assert_eq!(
        (network.labels(), network.input(), network.margin()),
        (&["left".into(), "other".into()][..], (8, 8), 0.0)
    );
    let [left, other] = network.sizes() else { panic!("a size for each class") };
    assert!(left.fits(0.5, 2.0) && !left.fits(0.4, 2.0));
    assert!(left.fits(2.0, 4.0) && !left.fits(1.9, 4.0) && !left.fits(9.0, 4.6));
    assert!(other.fits(0.0, 1e6));
    let pixels = (0..64).map(|i| if i % 8 < 4 { 180 } else { 60 }).collect();
    let image = GreyImage::from_vec(pixels, 8, 8).unwrap();
    let whole = Rectangle { x: 0.0, y: 0.0, width: 8.0, height: 8.0 };
    let turned = Rectangle { x: 4.0, y: 0.0, width: 8.0, height: 8.0 };
    for level in Level::available() {
        let mut recogniser = NetworkRecogniser::new(network.clone(), 8, 8).with_level(level);
        // 32 pixels one and 32 pixels minus one contrast from the mean.
        let contrast = 60.0 / (60.0 + super::super::MIN_CONTRAST);
        let odds = recogniser.classify(image.view(), whole).to_vec();
        assert!((odds[0] - (64.0 * contrast - 0.25)).abs() < 1e-3, "{odds:?}");
        assert!((odds[0] + odds[1]).abs() < 1e-4, "{odds:?}");
        let odds = recogniser.classify(image.view(), turned);
        assert!((odds[0] + 0.25).abs() < 1e-3, "a flat picture has no side: {odds:?}");
        let input: Vec<f32> = (0..64).map(|i| if i % 8 < 4 { 0.5 } else { 0.0 }).collect();
        assert_eq!(recogniser.output(&input), [16.0, 0.25]);
    }
}

#[test]
fn values_that_are_read_twice_keep_their_numbers() {
    let mut model = model();
    let graph = model.graph.as_mut().unwrap();
    graph.node[3] = node("Relu", &["c"], "r", Vec::new());
    graph.node.insert(4, node("Add", &["r", "c"], "d", Vec::new()));
    let network = Network::read(&model.encode_to_vec()).unwrap();
    let mut recogniser = NetworkRecogniser::new(network, 8, 8);
    // Above zero a number counts twice, below once.
    let input: Vec<f32> = (0..64).map(|i| if i % 8 < 4 { 1.0 } else { -1.0 }).collect();
    assert_eq!(recogniser.output(&input), [64.0, -32.0 + 0.25]);
}

#[test]
fn normalisation_and_means_are_those_of_the_format() {
    let mut model = model();
    let graph = model.graph.as_mut().unwrap();
    let each = |name: &str, value: f32| tensor(name, &[1], vec![value]);
    graph.initializer.extend([each("s", 3.0), each("t", 1.0), each("m", 0.5), each("v", 4.0)]);
    let epsilon = onnx::Attribute { name: "epsilon".into(), f: 1e-9, ..onnx::Attribute::default() };
    graph.node[1] = node("BatchNormalization", &["a", "s", "t", "m", "v"], "b", vec![epsilon]);
    graph.node[2] = node("GlobalAveragePool", &["b"], "d", Vec::new());
    graph.node.remove(3);
    graph.initializer[3] = tensor("w2", &[1, 2], vec![1.0, -1.0]);
    graph.node[4].attribute.clear();
    let mut recogniser = NetworkRecogniser::new(Network::read(&model.encode_to_vec()).unwrap(), 8, 8);
    let mean = (2.0 - 0.5) / 2.0 * 3.0 + 1.0;
    assert_eq!(recogniser.output(&[2.0; 64]), [mean, 0.25 - mean]);
}

#[test]
fn what_cannot_be_computed_is_named() {
    let bytes = model().encode_to_vec();
    for (found, expected) in [
        (
            with_graph(|g| g.node[2].op_type = "Resize".into()),
            "operator Resize of \"c\": this operator is not",
        ),
        (
            with_graph(|g| g.node[0].input[1] = "gone".into()),
            "operator Conv of \"a\": its weights are missing",
        ),
        (with_graph(|g| g.initializer[0].float_data[2] = f32::NAN), "not finite"),
        (with_graph(|g| g.initializer[0].dims[1] = 2), "operator Conv"),
        (with_graph(|g| g.initializer[0].dims[1] = -1), "operator Conv"),
        (with_graph(|g| g.initializer[0].dims = vec![i64::MAX; 4]), "operator Conv"),
        (with_graph(|g| g.node[0].attribute[0].ints[0] = i64::MAX), "its windows do not fit"),
        (with_graph(|g| g.node[0].attribute.push(ints("strides", &[0, 1]))), "its windows do not fit"),
        (with_graph(|g| g.node[0].attribute.push(ints("dilations", &[2, 2]))), "dilations"),
        (with_graph(|g| g.node[2].attribute[0].ints = vec![9, 9]), "its windows do not fit"),
        (with_graph(|g| g.node[5].attribute.clear()), "the sides of its weights do not fit"),
        (with_graph(|g| g.node[5].attribute.push(int("transA", 1))), "transA"),
        (with_graph(|g| g.node.swap(0, 1)), "operator Identity of \"b\": its input is not computed before"),
        (with_graph(|g| g.node[1].output[0] = "a".into()), "computed twice"),
        (with_graph(|g| g.input[0] = value("in", &[1, 3, 8, 8])), "the input should be"),
        (with_graph(|g| g.input[0] = value("in", &[1, 1, 8, 4096])), "the input should be"),
        (with_graph(|g| g.input.clear()), "one input"),
        (with_graph(|g| g.output.clear()), "one output"),
        (
            with_graph(|g| {
                g.node.truncate(3);
                g.output[0].name = "c".into();
            }),
            "should be a name for each",
        ),
        (
            with_graph(|g| g.output[0].name = "c".into()),
            "operator Softmax of \"out\": it does not stand at the end",
        ),
        (changed(|m| m.graph = None), "no graph"),
        (changed(|m| m.opset_import[0].version = 99), "operators of version 99: export with opset 9 to 25"),
        (changed(|m| m.metadata_props[0].value = "left".into()), "property \"labels\": \"left\""),
        (changed(|m| m.metadata_props[0].value = "a,a".into()), "property \"labels\""),
        (
            changed(|m| m.metadata_props[2].value = "left 2".into()),
            "property \"sizes\": \"left 2\" should be a label",
        ),
        (changed(|m| m.metadata_props[2].value = "up 2 1".into()), "property \"sizes\": \"up 2 1\""),
        (changed(|m| m.metadata_props[2].value = "left -2 1".into()), "property \"sizes\""),
        (changed(|m| m.metadata_props[2].value = "left 2 1 2 1".into()), "property \"sizes\""),
        (changed(|m| m.metadata_props[1].value = "wide".into()), "property \"margin\": \"wide\""),
        (Network::read(&bytes[..bytes.len() - 3]).unwrap_err().to_string(), "no ONNX file"),
        (Network::read(b"lookout-hog 1\n").unwrap_err().to_string(), "no ONNX file"),
        (Network::read(&vec![0; MAX_BYTES as usize + 1]).unwrap_err().to_string(), "at most 8388608"),
    ] {
        assert!(found.contains(expected), "{expected}: {found}");
    }
    // A network that would take seconds.
    let slow = with_graph(|g| {
        g.input[0] = value("in", &[1, 1, 256, 256]);
        g.initializer[0] = tensor("w1", &[48, 1, 33, 33], vec![0.0; 48 * 33 * 33]);
        g.node[0].attribute[0].ints = vec![16; 4];
    });
    assert!(slow.contains("products for a look"), "{slow}");
}
