//! A network: the plan in which an ONNX file is computed.
//!
//! The file has one input of 1 × 1 × height × width 32-bit numbers and one output with a number for each class (before
//! softmax; a softmax at the end changes nothing). The property `labels` names the classes, separated by commas; `other`
//! is none. The property `margin` is the margin around a region on each side, as a share of that side; 0.1 without it. The
//! property `sizes` has pairs of a height in metres and the smallest width up to there, as a share of the height:
//! `vehicle 2.2 0.35 4.3 0.6, rider 2.5 0.2`; above its last height is nothing of a class, and a class that it does not name may have any size.
//! Operators, with weights in the file: Conv (with `group` 1 or depthwise), Gemm, BatchNormalization, Relu, Clip, Add,
//! MaxPool, AveragePool, GlobalAveragePool, Flatten, Reshape to a row, Dropout, Identity, Softmax and LogSoftmax at the end.

use super::error::NetworkError;
use super::layer::{CHANNELS, Convolution, Pooling, Shape, Windows, padded_len};
use super::limits::{INPUT_PX, MAX_BYTES, MAX_PRODUCTS, OPSETS};
use super::onnx::{self, Node, Tensor};
use super::properties::{ClassSize, labels, margin, sizes};
use crate::excerpt::{VALUE_CHARS, excerpt};
use prost::Message;
use std::collections::HashMap;

/// Numbers of all values and weights together, in memory, and of the padded input of a layer.
const MAX_NUMBERS: usize = 4 << 20;

/// Largest weight.
const MAX_WEIGHT: f32 = 1e6;

/// Largest size, step or padding of a window.
const MAX_WINDOW: i64 = INPUT_PX.1 as i64;

/// What a step computes.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Operator {
    Convolution(Convolution),
    Pool(Pooling, Windows),
    Clip((f32, f32)),
    Add,
}

/// A step: an operator, the values that it reads, and the one that it computes. One that limits may compute what it reads.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Step {
    pub operator: Operator,
    pub from: [usize; 2],
    pub to: usize,
}

/// A network.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    /// Names of the classes, in the order of the output.
    labels: Vec<String>,
    sizes: Vec<ClassSize>,
    margin: f32,
    products: u64,
    pub(super) steps: Vec<Step>,
    /// Shapes of the values; the first is the input.
    pub(super) shapes: Vec<Shape>,
    pub(super) output: usize,
    /// Most numbers of the padded input of a layer.
    pub(super) padded: usize,
}

impl Network {
    /// Reads a network from the bytes of an ONNX file.
    ///
    /// # Errors
    /// If they are no ONNX file, or one that cannot be computed; the error names the operator.
    pub fn read(bytes: &[u8]) -> Result<Self, NetworkError> {
        if bytes.len() as u64 > MAX_BYTES {
            return Err(NetworkError::TooLarge { bytes: bytes.len() });
        }
        let model = onnx::Model::decode(bytes).map_err(|e| NetworkError::Format(e.to_string()))?;
        let own = model.opset_import.iter().find(|set| set.domain.is_empty() || set.domain == "ai.onnx");
        let version = own.map_or(0, |set| set.version);
        if !OPSETS.contains(&version) {
            return Err(NetworkError::Opset { version });
        }
        let graph = model.graph.as_ref().ok_or(NetworkError::Shape("no graph"))?;
        let [output] = &graph.output[..] else {
            return Err(NetworkError::Shape("a network needs one output"));
        };
        let mut plan = Plan::new(graph)?;
        for node in &graph.node {
            plan.add(node)?;
        }
        let output =
            plan.known.get(&output.name[..]).ok_or(NetworkError::Shape("the output is not computed"))?;
        let shape = plan.shapes[*output];
        let labels = labels(&model.metadata_props, shape.channels)?;
        if (shape.height, shape.width) != (1, 1) || *output == 0 {
            return Err(NetworkError::Shape(
                "the output should have a number for each class and nothing else",
            ));
        }
        let output = *output;
        let Plan { steps, shapes, padded, products, .. } = plan;
        let margin = margin(&model.metadata_props)?;
        let sizes = sizes(&model.metadata_props, &labels)?;
        Ok(Self { labels, sizes, margin, products, steps, shapes, output, padded })
    }

    /// Names of the classes, in the order of the output; `other` is none.
    pub fn labels(&self) -> &[String] {
        &self.labels
    }

    /// The sizes of the classes, in the order of the output.
    pub fn sizes(&self) -> &[ClassSize] {
        &self.sizes
    }

    /// Margin around a region on each side, as a share of that side.
    pub fn margin(&self) -> f32 {
        self.margin
    }

    /// Width and height of the input.
    pub fn input(&self) -> (usize, usize) {
        (self.shapes[0].width, self.shapes[0].height)
    }

    /// Products for a look.
    pub fn products(&self) -> u64 {
        self.products
    }
}

/// The plan while operators are added.
struct Plan<'m> {
    constants: HashMap<&'m str, &'m Tensor>,
    /// How often a value is read.
    uses: HashMap<&'m str, usize>,
    /// Values by their names.
    known: HashMap<&'m str, usize>,
    output: &'m str,
    steps: Vec<Step>,
    shapes: Vec<Shape>,
    numbers: usize,
    padded: usize,
    products: u64,
}

const NO_CONSTANT: &str = "its weights are missing, not finite, too large or not of 32-bit floating point";
const NO_SHAPE: &str = "the sides of its weights do not fit";
const NO_WINDOW: &str = "its windows do not fit the input";
const NO_MEMORY: &str = "the network needs too much memory";

impl<'m> Plan<'m> {
    fn new(graph: &'m onnx::Graph) -> Result<Self, NetworkError> {
        let constants: HashMap<&str, &Tensor> = graph.initializer.iter().map(|t| (&t.name[..], t)).collect();
        let mut inputs = graph.input.iter().filter(|input| !constants.contains_key(&input.name[..]));
        let (Some(input), None) = (inputs.next(), inputs.next()) else {
            return Err(NetworkError::Shape("a network needs one input"));
        };
        const INPUT: NetworkError = NetworkError::Shape(
            "the input should be 1 × 1 × height × width 32-bit floating-point numbers, 8 to 256 high and wide",
        );
        let tensor = input.r#type.as_ref().and_then(|t| t.tensor_type.as_ref()).ok_or(INPUT)?;
        let sides: Vec<i64> = tensor.shape.iter().flat_map(|s| s.dim.iter().map(|d| d.dim_value)).collect();
        let [0 | 1, 1, height, width] = sides[..] else { return Err(INPUT) };
        let side = |px: i64| {
            usize::try_from(px).ok().filter(|px| (INPUT_PX.0..=INPUT_PX.1).contains(px)).ok_or(INPUT)
        };
        let shape = Shape { height: side(height)?, width: side(width)?, channels: 1, stride: 1 };
        if tensor.elem_type != onnx::FLOAT {
            return Err(INPUT);
        }
        let mut uses = HashMap::new();
        for name in graph.node.iter().flat_map(|node| &node.input) {
            *uses.entry(&name[..]).or_insert(0) += 1;
        }
        Ok(Self {
            constants,
            uses,
            known: HashMap::from([(&input.name[..], 0)]),
            output: graph.output.first().map_or("", |o| &o.name[..]),
            steps: Vec::new(),
            shapes: vec![shape],
            numbers: shape.numbers(),
            padded: 0,
            products: 0,
        })
    }

    fn add(&mut self, node: &'m Node) -> Result<(), NetworkError> {
        let value = node.output.first().map_or("", |name| &name[..]);
        let fail = |why: &'static str| NetworkError::Operator {
            operator: excerpt(&node.op_type, VALUE_CHARS).into_owned(),
            value: excerpt(value, VALUE_CHARS).into_owned(),
            why,
        };
        if self.known.contains_key(value) {
            return Err(fail("its value is computed twice"));
        }
        if node.op_type == "Constant" {
            let constant = node.attribute.iter().find(|a| a.name == "value").and_then(|a| a.t.as_ref());
            self.constants.insert(value, constant.ok_or_else(|| fail(NO_CONSTANT))?);
            return Ok(());
        }
        let first = node.input.first().map_or("", |name| &name[..]);
        let from = *self.known.get(first).ok_or_else(|| fail("its input is not computed before"))?;
        let to = self.operator(node, from).map_err(fail)?;
        self.known.insert(value, to);
        if self.numbers > MAX_NUMBERS || self.padded > MAX_NUMBERS {
            return Err(fail(NO_MEMORY));
        }
        if self.products > MAX_PRODUCTS {
            return Err(NetworkError::Cost(self.products));
        }
        Ok(())
    }

    /// Adds an operator that reads value `from`, and returns the value that it computes.
    fn operator(&mut self, node: &'m Node, from: usize) -> Result<usize, &'static str> {
        let shape = self.shapes[from];
        let name = |i: usize| node.input.get(i).map_or("", |name| &name[..]);
        match &node.op_type[..] {
            "Conv" => {
                let layer = self.convolution(node, shape)?;
                self.convolve(from, layer)
            }
            "Gemm" => {
                let layer = self.product(node, shape)?;
                self.convolve(from, layer)
            }
            "BatchNormalization" => {
                let layer = self.normalisation(node, shape)?;
                self.convolve(from, layer)
            }
            "Relu" => self.clip((0.0, f32::MAX), name(0), from),
            "Clip" => {
                let limit = |i: usize, attribute: &str, default: f32| match self.constants.get(name(i)) {
                    Some(tensor) => tensor.floats().filter(|v| v.len() == 1).map(|v| v[0]),
                    None if name(i).is_empty() => {
                        Some(node.attribute.iter().find(|a| a.name == attribute).map_or(default, |a| a.f))
                    }
                    None => None,
                };
                let range = limit(1, "min", f32::MIN).zip(limit(2, "max", f32::MAX));
                let range = range.filter(|(low, high)| low <= high).ok_or("its limits are no constants")?;
                self.clip(range, name(0), from)
            }
            "Add" => {
                let other = *self.known.get(name(1)).ok_or("it adds no computed value")?;
                if self.shapes[other] != shape {
                    return Err("it adds values of different sides");
                }
                Ok(self.step(Operator::Add, [from, other], shape))
            }
            "MaxPool" | "AveragePool" => {
                let size = attribute(node, "kernel_shape").ok_or(NO_WINDOW)?;
                let windows = windows(node, size)?;
                if whole(node, "ceil_mode", 0) != 0 || node.output.len() > 1 {
                    return Err("ceil_mode and indices are not supported");
                }
                let counts_padding = whole(node, "count_include_pad", 0) != 0;
                let is_maximum = node.op_type == "MaxPool";
                let pooling = if is_maximum { Pooling::Maximum } else { Pooling::Mean(counts_padding) };
                self.pool(pooling, windows, from)
            }
            "GlobalAveragePool" => self.pool(Pooling::Mean(false), Windows::whole(shape), from),
            "Flatten" if whole(node, "axis", 1) == 1 => Ok(from),
            "Reshape" => {
                let sides = self.constants.get(name(1)).and_then(|t| t.whole());
                match sides.as_deref() {
                    Some([-1..=1, _]) if whole(node, "allowzero", 0) == 0 => Ok(from),
                    _ => Err("it makes no row of its input"),
                }
            }
            "Dropout" | "Identity" => Ok(from),
            "Softmax" | "LogSoftmax" if node.output.first().is_some_and(|o| o == self.output) => Ok(from),
            "Softmax" | "LogSoftmax" => Err("it does not stand at the end"),
            _ => Err("this operator is not supported (docs/recognition.md)"),
        }
    }

    /// Adds a step with a value of its own.
    fn step(&mut self, operator: Operator, from: [usize; 2], shape: Shape) -> usize {
        let to = self.shapes.len();
        self.shapes.push(shape);
        self.numbers = self.numbers.saturating_add(shape.numbers());
        self.steps.push(Step { operator, from, to });
        to
    }

    fn clip(&mut self, range: (f32, f32), name: &str, from: usize) -> Result<usize, &'static str> {
        // The value itself is limited, if nothing else reads it. A value with two names may have another reader.
        let names = self.known.values().filter(|&&value| value == from).count();
        if from != 0 && names == 1 && self.uses.get(name) == Some(&1) && name != self.output {
            self.steps.push(Step { operator: Operator::Clip(range), from: [from; 2], to: from });
            return Ok(from);
        }
        if from == 0 {
            return Err("it reads the input of the network");
        }
        Ok(self.step(Operator::Clip(range), [from; 2], self.shapes[from]))
    }

    fn pool(&mut self, pooling: Pooling, windows: Windows, from: usize) -> Result<usize, &'static str> {
        let shape = self.shapes[from];
        if from == 0 {
            return Err("it reads the input of the network");
        }
        let (height, width) = windows.count(shape).ok_or(NO_WINDOW)?;
        let is_larger = |padding: usize, size: usize| padding >= size && padding > 0;
        let [top, left, bottom, right] = windows.padding;
        if is_larger(top.max(bottom), windows.size.0) || is_larger(left.max(right), windows.size.1) {
            return Err(NO_WINDOW);
        }
        let out = Shape { height, width, ..shape };
        self.count(out.numbers(), windows.size.0 * windows.size.1);
        Ok(self.step(Operator::Pool(pooling, windows), [from; 2], out))
    }

    fn count(&mut self, numbers: usize, each: usize) {
        self.products = self.products.saturating_add((numbers as u64).saturating_mul(each as u64));
    }

    fn convolve(&mut self, from: usize, layer: Convolution) -> Result<usize, &'static str> {
        let shape = self.shapes[from];
        let (height, width) = layer.windows.count(shape).ok_or(NO_WINDOW)?;
        let out = Shape { height, width, channels: layer.channels, stride: layer.bias.len() };
        let inputs = if layer.is_depthwise { 1 } else { shape.stride };
        self.count(out.numbers(), layer.windows.size.0 * layer.windows.size.1 * inputs);
        self.padded = self.padded.max(padded_len(shape, &layer.windows));
        self.numbers = self.numbers.saturating_add(layer.weights.len());
        Ok(self.step(Operator::Convolution(layer), [from; 2], out))
    }

    /// The numbers of a constant, which are weights.
    fn weights(&self, name: &str) -> Option<(Vec<usize>, Vec<f32>)> {
        let tensor = self.constants.get(name)?;
        let weights = tensor.floats()?;
        // NaN is in no range.
        weights.iter().all(|w| (-MAX_WEIGHT..=MAX_WEIGHT).contains(w)).then_some((tensor.sides()?, weights))
    }

    /// The bias of `count` channels.
    fn bias(&self, name: &str, count: usize) -> Result<Vec<f32>, &'static str> {
        let mut bias = match name {
            "" => vec![0.0; count],
            name => self.weights(name).ok_or(NO_CONSTANT)?.1,
        };
        if bias.len() != count {
            return Err(NO_SHAPE);
        }
        bias.resize(count.next_multiple_of(CHANNELS), 0.0);
        Ok(bias)
    }

    fn convolution(&self, node: &Node, from: Shape) -> Result<Convolution, &'static str> {
        let name = |i: usize| node.input.get(i).map_or("", |name| &name[..]);
        let (sides, weights) = self.weights(name(1)).ok_or(NO_CONSTANT)?;
        let [outputs, inputs, height, width] = sides[..] else { return Err(NO_SHAPE) };
        let windows = windows(node, [height, width])?;
        let group = whole(node, "group", 1);
        let is_depthwise = group != 1;
        let fits = if is_depthwise {
            usize::try_from(group) == Ok(outputs)
                && inputs == 1
                && outputs == from.channels
                && from.stride > 1
        } else {
            inputs == from.channels
        };
        if !fits || outputs == 0 {
            return Err(NO_SHAPE);
        }
        let bias = self.bias(name(2), outputs)?;
        let each = if is_depthwise { 1 } else { from.stride };
        let mut layer = Convolution::zero(windows, is_depthwise, each, outputs, bias)?;
        for (i, &weight) in weights.iter().enumerate() {
            let (output, input) = (i / (inputs * height * width), i / (height * width) % inputs);
            layer.set(output, i % (height * width), input, each, weight);
        }
        Ok(layer)
    }

    /// A product of a flat value with a matrix: a convolution with a window of the value's size.
    fn product(&self, node: &Node, from: Shape) -> Result<Convolution, &'static str> {
        let name = |i: usize| node.input.get(i).map_or("", |name| &name[..]);
        let factor = |name: &str| node.attribute.iter().find(|a| a.name == name).map_or(1.0, |a| a.f);
        if whole(node, "transA", 0) != 0 || factor("alpha") != 1.0 || factor("beta") != 1.0 {
            return Err("transA, alpha and beta are not supported");
        }
        let (sides, weights) = self.weights(name(1)).ok_or(NO_CONSTANT)?;
        let [rows, columns] = sides[..] else { return Err(NO_SHAPE) };
        let is_transposed = whole(node, "transB", 0) != 0;
        let (outputs, inputs) = if is_transposed { (rows, columns) } else { (columns, rows) };
        let pixels = from.height * from.width;
        if inputs != from.channels * pixels || outputs == 0 {
            return Err(NO_SHAPE);
        }
        let bias = self.bias(name(2), outputs)?;
        let mut layer = Convolution::zero(Windows::whole(from), false, from.stride, outputs, bias)?;
        for (i, &weight) in weights.iter().enumerate() {
            let (row, column) = (i / columns, i % columns);
            let (output, input) = if is_transposed { (row, column) } else { (column, row) };
            layer.set(output, input % pixels, input / pixels, from.stride, weight);
        }
        Ok(layer)
    }

    fn normalisation(&self, node: &Node, from: Shape) -> Result<Convolution, &'static str> {
        let epsilon = node.attribute.iter().find(|a| a.name == "epsilon").map_or(1e-5, |a| a.f);
        let name = |i: usize| node.input.get(i).map_or("", |name| &name[..]);
        let each = |i: usize| {
            let (_, values) = self.weights(name(i)).ok_or(NO_CONSTANT)?;
            if values.len() == from.channels { Ok(values) } else { Err(NO_SHAPE) }
        };
        let (scale, shift, mean, variance) = (each(1)?, each(2)?, each(3)?, each(4)?);
        if from.stride == 1 || node.output.len() > 1 {
            return Err(NO_SHAPE);
        }
        let mut bias = vec![0.0; from.stride];
        let windows = Windows { size: (1, 1), step: (1, 1), padding: [0; 4] };
        let mut layer = Convolution::zero(windows, true, 1, from.channels, Vec::new())?;
        for channel in 0..from.channels {
            let factor = scale[channel] / (variance[channel].max(0.0) + epsilon.max(1e-12)).sqrt();
            bias[channel] = shift[channel] - mean[channel] * factor;
            layer.set(channel, 0, 0, 1, factor);
        }
        layer.bias = bias;
        Ok(layer)
    }
}

/// A list of two numbers.
fn attribute(node: &Node, name: &str) -> Option<[usize; 2]> {
    let list = &node.attribute.iter().find(|a| a.name == name)?.ints;
    let [down, across] = list[..] else { return None };
    let side = |v: i64| usize::try_from(v).ok().filter(|_| v <= MAX_WINDOW);
    Some([side(down)?, side(across)?])
}

/// A whole number.
fn whole(node: &Node, name: &str, default: i64) -> i64 {
    node.attribute.iter().find(|a| a.name == name).map_or(default, |a| a.i)
}

/// The windows of an operator.
fn windows(node: &Node, [height, width]: [usize; 2]) -> Result<Windows, &'static str> {
    let has = |name: &str| node.attribute.iter().any(|a| a.name == name);
    let auto = node.attribute.iter().find(|a| a.name == "auto_pad");
    if auto.is_some_and(|a| a.s != b"NOTSET" && !a.s.is_empty()) {
        return Err("auto_pad is not supported: export with pads");
    }
    if has("dilations") && attribute(node, "dilations") != Some([1, 1]) {
        return Err("dilations are not supported");
    }
    let step = if has("strides") { attribute(node, "strides").ok_or(NO_WINDOW)? } else { [1, 1] };
    let mut padding = [0; 4];
    if let Some(pads) = node.attribute.iter().find(|a| a.name == "pads") {
        if pads.ints.len() != padding.len() || !pads.ints.iter().all(|v| (0..=MAX_WINDOW).contains(v)) {
            return Err(NO_WINDOW);
        }
        for (side, &pad) in padding.iter_mut().zip(&pads.ints) {
            *side = usize::try_from(pad).unwrap_or(0);
        }
    }
    let size = (height, width);
    if [height, width, step[0], step[1]].iter().any(|&v| v == 0 || v > INPUT_PX.1) {
        return Err(NO_WINDOW);
    }
    Ok(Windows { size, step: (step[0], step[1]), padding })
}

impl Convolution {
    /// A convolution whose weights are 0, of `each` numbers of a pixel to `channels`.
    fn zero(
        windows: Windows,
        is_depthwise: bool,
        each: usize,
        channels: usize,
        bias: Vec<f32>,
    ) -> Result<Self, &'static str> {
        let pixels = windows.size.0.saturating_mul(windows.size.1);
        // In whole blocks of channels there are more than in the file.
        let numbers = pixels.saturating_mul(each).saturating_mul(channels.next_multiple_of(CHANNELS));
        if numbers > MAX_NUMBERS {
            return Err(NO_MEMORY);
        }
        Ok(Self { windows, is_depthwise, channels, weights: vec![0.0; numbers], bias })
    }

    /// Sets the weight of a number (pixel of the window, channel of the input) for a channel of the output.
    fn set(&mut self, output: usize, pixel: usize, input: usize, each: usize, weight: f32) {
        if self.is_depthwise {
            let stride = self.channels.next_multiple_of(CHANNELS);
            self.weights[pixel * stride + output] = weight;
            return;
        }
        let numbers = self.windows.size.0 * self.windows.size.1 * each;
        let at = (output / CHANNELS * numbers + pixel * each + input) * CHANNELS + output % CHANNELS;
        self.weights[at] = weight;
    }
}

#[cfg(test)]
mod tests;
