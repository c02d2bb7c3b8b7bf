//! The names under which ROS 2 over zenoh finds messages: those of `rmw_zenoh_cpp` of ROS 2 Jazzy and later
//! (<https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md>).
//!
//! - messages: `<domain>/<topic>/<type>/<type hash>`, with an attachment of sequence number, time and publisher;
//! - liveliness tokens, by which `ros2 node list` and `ros2 topic list` know them:
//!   `@ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/<enclave>/<namespace>/<name>`, and for a publisher
//!   `/<topic>/<type>/<type hash>/<quality of service>`; in each part `%` stands for `/`, or for nothing.

/// A type of messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Type {
    /// Its name in keys.
    pub name: &'static str,
    /// Its hash after REP 2016, which follows from the names and types of all fields.
    pub hash: &'static str,
}

/// `vision_msgs/msg/Detection3DArray` (`vision_msgs` 4).
pub const DETECTIONS: Type = Type {
    name: "vision_msgs::msg::dds_::Detection3DArray_",
    hash: "RIHS01_793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018",
};
/// `stereo_msgs/msg/DisparityImage`.
pub const DISPARITY: Type = Type {
    name: "stereo_msgs::msg::dds_::DisparityImage_",
    hash: "RIHS01_1ec1ff6b5bace919e4544a37f2d96ead9f81783701b7b7a4d97a09325ecf2711",
};
/// `sensor_msgs/msg/Image`.
pub const IMAGE: Type = Type {
    name: "sensor_msgs::msg::dds_::Image_",
    hash: "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
};
/// `diagnostic_msgs/msg/DiagnosticArray`.
pub const DIAGNOSTICS: Type = Type {
    name: "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    hash: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
};
/// `nav_msgs/msg/Odometry`.
pub const ODOMETRY: Type = Type {
    name: "nav_msgs::msg::dds_::Odometry_",
    hash: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
};

/// The topics of a vehicle: last part of the name, and type.
pub const TOPICS: [(&str, Type); 5] = [
    ("detections", DETECTIONS),
    ("disparity", DISPARITY),
    ("image", IMAGE),
    ("diagnostics", DIAGNOSTICS),
    ("odometry", ODOMETRY),
];

/// Quality of service of all publishers: the defaults (reliable, volatile), the last 10 messages.
const QUALITY: &str = "::,10:,:,:,,";

/// Names of the node and its entities in the liveliness tokens: the session has one node.
const NODE: &str = "0";

/// A node in the graph of ROS 2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Node {
    /// The domain (`ROS_DOMAIN_ID`).
    pub domain: u32,
    /// Its namespace, with slashes between its parts, without one before it.
    pub namespace: String,
    /// Its name.
    pub name: String,
}

impl Node {
    /// The node of a vehicle: `lookout` in the namespace `<fleet>/<vehicle>`.
    pub fn of_vehicle(domain: u32, fleet: &str, vehicle: &str) -> Self {
        let namespace = format!("{}/{}", part(fleet), part(vehicle));
        Self { domain, namespace, name: "lookout".into() }
    }

    /// Name of a topic, without a slash before it.
    pub fn topic(&self, last: &str) -> String {
        format!("{}/{}/{last}", self.namespace, self.name)
    }

    /// Key of the messages of a topic.
    pub fn key(&self, last: &str, of: &Type) -> String {
        format!("{}/{}/{}/{}", self.domain, self.topic(last), of.name, of.hash)
    }

    /// Key of the node's liveliness token in a session.
    pub fn token(&self, session: &str) -> String {
        self.entity(session, 0, "NN")
    }

    /// Key of the liveliness token of a topic's publisher, whose number is `entity`, from 1.
    pub fn publisher_token(&self, session: &str, entity: usize, last: &str, of: &Type) -> String {
        let topic = mangled(&self.topic(last));
        format!("{}/{topic}/{}/{}/{QUALITY}", self.entity(session, entity, "MP"), of.name, of.hash)
    }

    fn entity(&self, session: &str, entity: usize, kind: &str) -> String {
        let Self { domain, namespace, name } = self;
        format!("@ros2_lv/{domain}/{session}/{NODE}/{entity}/{kind}/%/{}/{name}", mangled(namespace))
    }
}

/// A name with a slash before it, as part of a key.
fn mangled(name: &str) -> String {
    format!("%{}", name.replace('/', "%"))
}

/// A part of a name of ROS 2: letters, digits and underscores, no digit first.
fn part(text: &str) -> String {
    let mut part: String = text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !part.starts_with(|c: char| c.is_ascii_alphabetic()) {
        part.insert(0, 'v');
    }
    part
}

/// The attachment of a message: number in its topic, from 1; time in ns since 1970; 16 bytes that identify the publisher.
pub fn attachment(number: i64, time_ns: i64, publisher: [u8; 16]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(33);
    bytes.extend_from_slice(&number.to_le_bytes());
    bytes.extend_from_slice(&time_ns.to_le_bytes());
    bytes.push(publisher.len() as u8);
    bytes.extend_from_slice(&publisher);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_rmw_zenoh() {
        let node = Node::of_vehicle(3, "north", "7-up");
        assert_eq!(
            node.key("odometry", &ODOMETRY),
            format!("3/north/v7_up/lookout/odometry/nav_msgs::msg::dds_::Odometry_/{}", ODOMETRY.hash)
        );
        assert_eq!(node.token("ab12"), "@ros2_lv/3/ab12/0/0/NN/%/%north%v7_up/lookout");
        assert_eq!(
            node.publisher_token("ab12", 2, "image", &IMAGE),
            format!(
                "@ros2_lv/3/ab12/0/2/MP/%/%north%v7_up/lookout/%north%v7_up%lookout%image/{}/{}/::,10:,:,:,,",
                IMAGE.name, IMAGE.hash
            )
        );
        assert_eq!((part("-"), part("a.b")), ("v_".into(), "a_b".into()));
        let bytes = attachment(1, 2, [5; 16]);
        assert_eq!((bytes.len(), bytes[0], bytes[8], bytes[16], bytes[32]), (33, 1, 2, 16, 5));
    }
}
