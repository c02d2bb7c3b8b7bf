//! The parts of ONNX's file format that networks here need (`onnx.proto3` of the ONNX specification, which is
//! released under Apache-2.0): field numbers are the format.

use prost::Message;

/// A model.
#[derive(Clone, PartialEq, Message)]
pub struct Model {
    /// Sets of operators that it uses.
    #[prost(message, repeated, tag = "8")]
    pub opset_import: Vec<OperatorSet>,
    /// Its graph.
    #[prost(message, optional, tag = "7")]
    pub graph: Option<Graph>,
    /// Properties that the format leaves open.
    #[prost(message, repeated, tag = "14")]
    pub metadata_props: Vec<Property>,
}

/// A set of operators.
#[derive(Clone, PartialEq, Message)]
pub struct OperatorSet {
    /// Empty for ONNX's own.
    #[prost(string, tag = "1")]
    pub domain: String,
    /// Its version.
    #[prost(int64, tag = "2")]
    pub version: i64,
}

/// A property of a model.
#[derive(Clone, PartialEq, Message)]
pub struct Property {
    /// Name.
    #[prost(string, tag = "1")]
    pub key: String,
    /// Value.
    #[prost(string, tag = "2")]
    pub value: String,
}

/// A graph of operators, in an order in which they can be computed.
#[derive(Clone, PartialEq, Message)]
pub struct Graph {
    /// The operators.
    #[prost(message, repeated, tag = "1")]
    pub node: Vec<Node>,
    /// Constants.
    #[prost(message, repeated, tag = "5")]
    pub initializer: Vec<Tensor>,
    /// Inputs; in old files the constants, too.
    #[prost(message, repeated, tag = "11")]
    pub input: Vec<ValueInfo>,
    /// Outputs.
    #[prost(message, repeated, tag = "12")]
    pub output: Vec<ValueInfo>,
}

/// An operator with the names of its values.
#[derive(Clone, PartialEq, Message)]
pub struct Node {
    /// Names of what it reads; empty for one that is left out.
    #[prost(string, repeated, tag = "1")]
    pub input: Vec<String>,
    /// Names of what it computes.
    #[prost(string, repeated, tag = "2")]
    pub output: Vec<String>,
    /// Name of the operator.
    #[prost(string, tag = "4")]
    pub op_type: String,
    /// Its parameters.
    #[prost(message, repeated, tag = "5")]
    pub attribute: Vec<Attribute>,
}

/// A parameter of an operator.
#[derive(Clone, PartialEq, Message)]
pub struct Attribute {
    /// Name.
    #[prost(string, tag = "1")]
    pub name: String,
    /// A number.
    #[prost(float, tag = "2")]
    pub f: f32,
    /// A whole number.
    #[prost(int64, tag = "3")]
    pub i: i64,
    /// A text.
    #[prost(bytes = "vec", tag = "4")]
    pub s: Vec<u8>,
    /// A constant.
    #[prost(message, optional, tag = "5")]
    pub t: Option<Tensor>,
    /// Whole numbers.
    #[prost(int64, repeated, tag = "8")]
    pub ints: Vec<i64>,
}

/// A constant.
#[derive(Clone, PartialEq, Message)]
pub struct Tensor {
    /// Its sides.
    #[prost(int64, repeated, tag = "1")]
    pub dims: Vec<i64>,
    /// Type of its values: [`FLOAT`] or [`INT64`].
    #[prost(int32, tag = "2")]
    pub data_type: i32,
    /// Values, if they are not raw.
    #[prost(float, repeated, tag = "4")]
    pub float_data: Vec<f32>,
    /// The same of whole numbers.
    #[prost(int64, repeated, tag = "7")]
    pub int64_data: Vec<i64>,
    /// Name.
    #[prost(string, tag = "8")]
    pub name: String,
    /// Values, little-endian.
    #[prost(bytes = "vec", tag = "9")]
    pub raw_data: Vec<u8>,
    /// 1 if the values lie in another file.
    #[prost(int32, tag = "14")]
    pub data_location: i32,
}

/// Type of a tensor of 32-bit floating-point numbers.
pub const FLOAT: i32 = 1;

/// Type of a tensor of 64-bit whole numbers.
pub const INT64: i32 = 7;

impl Tensor {
    /// Its floating-point numbers; `None` if it holds others, or not as many as its sides say.
    pub fn floats(&self) -> Option<Vec<f32>> {
        let count = self.count()?;
        let values = if self.raw_data.is_empty() {
            self.float_data.clone()
        } else {
            let (numbers, rest) = self.raw_data.as_chunks::<4>();
            rest.is_empty().then(|| numbers.iter().map(|b| f32::from_le_bytes(*b)).collect())?
        };
        (self.data_type == FLOAT && self.data_location == 0 && values.len() == count).then_some(values)
    }

    /// Its whole numbers; see [`Tensor::floats`].
    pub fn whole(&self) -> Option<Vec<i64>> {
        let count = self.count()?;
        let values = if self.raw_data.is_empty() {
            self.int64_data.clone()
        } else {
            let (numbers, rest) = self.raw_data.as_chunks::<8>();
            rest.is_empty().then(|| numbers.iter().map(|b| i64::from_le_bytes(*b)).collect())?
        };
        (self.data_type == INT64 && self.data_location == 0 && values.len() == count).then_some(values)
    }

    /// Number of its values.
    fn count(&self) -> Option<usize> {
        self.sides()?.into_iter().try_fold(1_usize, usize::checked_mul)
    }

    /// Its sides.
    pub fn sides(&self) -> Option<Vec<usize>> {
        self.dims.iter().map(|&side| usize::try_from(side).ok()).collect()
    }
}

/// Name and type of an input or output.
#[derive(Clone, PartialEq, Message)]
pub struct ValueInfo {
    /// Name.
    #[prost(string, tag = "1")]
    pub name: String,
    /// Type.
    #[prost(message, optional, tag = "2")]
    pub r#type: Option<Type>,
}

/// Type of a value.
#[derive(Clone, PartialEq, Message)]
pub struct Type {
    /// That of a tensor.
    #[prost(message, optional, tag = "1")]
    pub tensor_type: Option<TensorType>,
}

/// Type of a tensor.
#[derive(Clone, PartialEq, Message)]
pub struct TensorType {
    /// Type of its values.
    #[prost(int32, tag = "1")]
    pub elem_type: i32,
    /// Its sides.
    #[prost(message, optional, tag = "2")]
    pub shape: Option<Shape>,
}

/// Sides of a tensor.
#[derive(Clone, PartialEq, Message)]
pub struct Shape {
    /// The sides.
    #[prost(message, repeated, tag = "1")]
    pub dim: Vec<Dimension>,
}

/// A side of a tensor.
#[derive(Clone, PartialEq, Message)]
pub struct Dimension {
    /// Its length; 0 if that has a name instead.
    #[prost(int64, tag = "1")]
    pub dim_value: i64,
}
