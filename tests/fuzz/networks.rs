//! Networks: ONNX files with random graphs.

use super::harness::{Format, fuzz_format};
use fastrand::Rng;
use perception::image::GreyView;
use perception::recognition::network::sample::Rectangle;
use perception::recognition::network::{Network, NetworkRecogniser, onnx};
use prost::Message;

fn tensor(name: String, sides: &[i64], random: &mut Rng) -> onnx::Tensor {
    let count = sides.iter().product::<i64>();
    let float_data = (0..count).map(|_| random.f32() - 0.5).collect();
    onnx::Tensor { name, dims: sides.to_vec(), data_type: onnx::FLOAT, float_data, ..Default::default() }
}

fn ints(name: &str, ints: &[i64]) -> onnx::Attribute {
    onnx::Attribute { name: name.into(), ints: ints.to_vec(), ..Default::default() }
}

/// A network of some layers and a product at the end.
fn some_network(random: &mut Rng) -> Vec<u8> {
    let (mut height, mut width) = (random.i64(8..20), random.i64(8..20));
    let dim = [1, 1, height, width].map(|dim_value| onnx::Dimension { dim_value }).to_vec();
    let tensor_type = Some(onnx::TensorType { elem_type: onnx::FLOAT, shape: Some(onnx::Shape { dim }) });
    let input = onnx::ValueInfo { name: "v0".into(), r#type: Some(onnx::Type { tensor_type }) };
    let mut graph = onnx::Graph { input: vec![input], ..Default::default() };
    let (mut channels, mut last) = (1, 0);
    for layer in 0..random.usize(1..5) {
        let mut names = vec![format!("v{last}")];
        let mut attribute = Vec::new();
        let kind = if layer == 0 { 0 } else { random.u8(0..6) };
        let op_type = match kind {
            0 | 1 => {
                let outputs = random.i64(1..20);
                graph.initializer.push(tensor(format!("w{layer}"), &[outputs, channels, 3, 3], random));
                names.push(format!("w{layer}"));
                attribute.push(ints("pads", &[1, 1, 1, 1]));
                channels = outputs;
                "Conv"
            }
            2 => "Relu",
            3 => {
                names.push(names[0].clone());
                "Add"
            }
            4 if height > 4 && width > 4 => {
                attribute.extend([ints("kernel_shape", &[2, 2]), ints("strides", &[2, 2])]);
                (height, width) = (height / 2, width / 2);
                if random.bool() { "MaxPool" } else { "AveragePool" }
            }
            _ => "Identity",
        };
        last += 1;
        let output = vec![format!("v{last}")];
        graph.node.push(onnx::Node { op_type: op_type.into(), input: names, output, attribute });
    }
    let classes = random.i64(2..5);
    graph.initializer.push(tensor("end".into(), &[channels * height * width, classes], random));
    let node = |op_type: &str, input: Vec<String>, output: &str| onnx::Node {
        op_type: op_type.into(),
        input,
        output: vec![output.into()],
        attribute: Vec::new(),
    };
    graph.node.push(node("Flatten", vec![format!("v{last}")], "flat"));
    graph.node.push(node("Gemm", vec!["flat".into(), "end".into()], "out"));
    graph.output.push(onnx::ValueInfo { name: "out".into(), r#type: None });
    let labels = ["other", "one", "two", "three"][..classes as usize].join(",");
    let model = onnx::Model {
        opset_import: vec![onnx::OperatorSet { domain: String::new(), version: 17 }],
        graph: Some(graph),
        metadata_props: vec![onnx::Property { key: "labels".into(), value: labels }],
    };
    model.encode_to_vec()
}

fn any<'v, T>(random: &mut Rng, values: &'v mut [T]) -> Option<&'v mut T> {
    let at = random.usize(0..values.len().max(1));
    values.get_mut(at)
}

const NUMBERS: [i64; 9] = [-1, 0, 1, 2, 3, 16, 257, 1 << 20, i64::MAX];
const OPERATORS: [&str; 9] =
    ["Conv", "Gemm", "BatchNormalization", "Relu", "Clip", "Add", "GlobalAveragePool", "Reshape", "Softmax"];

/// Changes a number, an operator or a name of a network, or takes a node of another.
fn change(random: &mut Rng, bytes: &mut Vec<u8>, other: &[u8]) {
    let Ok(mut model) = onnx::Model::decode(&bytes[..]) else { return };
    let Some(graph) = &mut model.graph else { return };
    let number = NUMBERS[random.usize(0..NUMBERS.len())];
    match random.u8(0..8) {
        0 => {
            let node = any(random, &mut graph.node);
            if let Some(node) = node {
                node.op_type = OPERATORS[random.usize(0..OPERATORS.len())].into();
            }
        }
        1 => {
            let tensor = any(random, &mut graph.initializer);
            let side = tensor.and_then(|t| any(random, &mut t.dims));
            side.into_iter().for_each(|side| *side = number);
        }
        2 => {
            let node = any(random, &mut graph.node);
            let attribute = node.and_then(|n| any(random, &mut n.attribute));
            if let Some(attribute) = attribute {
                attribute.i = number;
                any(random, &mut attribute.ints).into_iter().for_each(|v| *v = number);
            }
        }
        3 => {
            let name = graph.node.get(random.usize(0..graph.node.len().max(1))).map(|n| n.output.concat());
            let node = any(random, &mut graph.node);
            let place = node.and_then(|n| any(random, &mut n.input));
            place.into_iter().zip(name).for_each(|(place, name)| *place = name);
        }
        4 => {
            let tensor = any(random, &mut graph.initializer);
            let weight = tensor.and_then(|t| any(random, &mut t.float_data));
            weight.into_iter().for_each(|w| *w = [f32::NAN, f32::MAX, 0.0, -1e5][random.usize(0..4)]);
        }
        5 => {
            let shape =
                graph.input.first_mut().and_then(|i| i.r#type.as_mut()?.tensor_type.as_mut()?.shape.as_mut());
            let side = shape.and_then(|shape| any(random, &mut shape.dim));
            side.into_iter().for_each(|side| side.dim_value = number);
        }
        6 => {
            let node = any(random, &mut graph.node);
            if let Some(node) = node {
                let name = ["group", "strides", "axis", "epsilon", "transB"][random.usize(0..5)];
                let mut attribute = ints(name, &[number, 1]);
                attribute.i = number;
                node.attribute.push(attribute);
            }
        }
        _ => {
            let other = onnx::Model::decode(other).ok().and_then(|m| m.graph).unwrap_or_default();
            if let Some(node) = other.node.get(random.usize(0..other.node.len().max(1))) {
                graph.node.insert(random.usize(0..graph.node.len() + 1), node.clone());
            }
        }
    }
    *bytes = model.encode_to_vec();
}

/// Random networks, and those that ship.
#[test]
fn network() {
    let shipped = super::harness::files("models", "onnx");
    let picture: Vec<u8> = (0..64 * 48_u32).map(|i| (i * i % 251) as u8).collect();
    let mut generate = |random: &mut Rng| match random.u8(0..30) {
        0 => shipped[random.usize(0..shipped.len())].clone(),
        _ => some_network(random),
    };
    let format = Format { name: "networks::network", longest: 1 << 18, generate: &mut generate, change };
    fuzz_format(format, |input, _| {
        let network = Network::read(input).map_err(|e| e.to_string())?;
        // What was accepted can be used.
        let classes = network.labels().len();
        let view = GreyView::new(&picture, 64, 48, 64).expect("a picture");
        let region = Rectangle { x: 20.0, y: 10.0, width: 30.0, height: 30.0 };
        let mut recogniser = NetworkRecogniser::new(network, 64, 48);
        let told = recogniser.classify(view, region);
        assert!(told.iter().all(|v| v.is_finite()), "{told:?}");
        Ok(format!("ok {classes}"))
    });
}
