//! Schemas of the messages of a recording.

use sources::recording::foxglove::MessageType;

/// The type of a topic's messages: schema and encoding.
#[derive(Clone, Copy, Debug)]
pub enum Schema {
    /// A Foxglove message in Protocol Buffers.
    Protobuf(MessageType),
    /// A document of `lookout` in JSON, with a JSON schema.
    Json {
        /// Name of the type.
        name: &'static str,
        /// The schema.
        text: &'static str,
    },
}

impl Schema {
    /// Name of the type.
    pub fn name(self) -> &'static str {
        match self {
            Self::Protobuf(message) => message.name,
            Self::Json { name, .. } => name,
        }
    }

    /// Encoding of the schema, as in the MCAP specification.
    pub fn encoding(self) -> &'static str {
        match self {
            Self::Protobuf(_) => "protobuf",
            Self::Json { .. } => "jsonschema",
        }
    }

    /// Encoding of the messages, as in the MCAP specification.
    pub fn message_encoding(self) -> &'static str {
        match self {
            Self::Protobuf(_) => "protobuf",
            Self::Json { .. } => "json",
        }
    }

    /// The schema.
    pub fn data(self) -> &'static [u8] {
        match self {
            Self::Protobuf(message) => message.descriptor_set,
            Self::Json { text, .. } => text.as_bytes(),
        }
    }
}

/// `lookout.Pair`.
pub const PAIR: Schema = Schema::Json {
    name: "lookout.Pair",
    text: r#"{"title":"lookout.Pair","type":"object","description":"What ties a left and a right image of the same time together",
"properties":{
"sequence":{"type":"integer","description":"Number of the pair in its source, from 0"},
"source_ns":{"type":"integer","description":"Time in the scene, in nanoseconds"},
"capture_ns":{"type":"integer","description":"When it was captured, on the monotonic clock of the machine, in nanoseconds"},
"width":{"type":"integer"},"height":{"type":"integer"}}}"#,
};

/// `lookout.Vehicle`.
pub const VEHICLE: Schema = Schema::Json {
    name: sources::recording::VEHICLE_SCHEMA,
    text: r#"{"title":"lookout.Vehicle","type":"object","description":"What the vehicle itself reported at a pair; null where a value is not configured, missing, stale or out of range",
"properties":{
"speed_m_s":{"type":["number","null"],"description":"Speed, forwards positive"},
"speed_age_s":{"type":["number","null"],"description":"Time from its measurement to the exposure of the pair"},
"yaw_rate_rad_s":{"type":["number","null"],"description":"Yaw rate, to the left positive"},
"yaw_rate_age_s":{"type":["number","null"],"description":"Time from its measurement to the exposure of the pair"},
"steering_angle_rad":{"type":["number","null"],"description":"Angle of the steering wheel, to the left positive"},
"braking":{"type":["boolean","null"]},
"turn_indicator":{"type":["string","null"],"enum":["off","left","right","both",null]},
"gear":{"type":["string","null"],"enum":["park","reverse","neutral","forward",null]},
"faults":{"type":"object","description":"Why values are missing","properties":{"no_bus":{"type":"boolean"},"missing":{"type":"boolean"},"stale":{"type":"boolean"},"out_of_range":{"type":"boolean"}}}}}"#,
};

/// `lookout.Obstacles`: a line of `obstacles.jsonl`.
pub const OBSTACLES: Schema = Schema::Json {
    name: "lookout.Obstacles",
    text: r#"{"title":"lookout.Obstacles","type":"object","description":"What came out of one frame: a line of obstacles.jsonl",
"properties":{
"sequence":{"type":"integer"},"time_s":{"type":"number","description":"Time in the scene"},
"road":{"type":["object","null"],"properties":{"camera_height_m":{"type":"number"},"horizon_px":{"type":"number"},"confidence":{"type":"number"}}},
"motion":{"type":"object","description":"The vehicle's own motion; yaw rate to the left positive","properties":{"known":{"type":"boolean"},"sources":{"type":"array","items":{"type":"string"}},"standstill":{"type":"boolean"},"disagree":{"type":"boolean"},"speed_m_s":{"type":["number","null"]},"speed_sigma_m_s":{"type":["number","null"]},"acceleration_m_s2":{"type":["number","null"]},"acceleration_sigma_m_s2":{"type":["number","null"]},"yaw_rate_rad_s":{"type":["number","null"]},"yaw_rate_sigma_rad_s":{"type":["number","null"]}}},
"path":{"type":"object","description":"The strip that the vehicle will sweep: edges as right and forward of the left camera","properties":{"known":{"type":"boolean"},"curvature_per_m":{"type":["number","null"]},"curvature_sigma_per_m":{"type":["number","null"]},"left_m":{"type":"array"},"right_m":{"type":"array"},"sigma_m":{"type":"array"}}},
"free_space_m":{"type":"array","description":"Polygons on the road that are known to be free: corners as right and forward of the left camera","items":{"type":"array"}},
"boundaries":{"type":"array","description":"Walls, hedges, fences, guard rails, fronts of houses beside the path","items":{"type":"object","properties":{"id":{"type":"integer"},"side":{"type":"string","enum":["left","right","across"]},"points_m":{"type":"array"},"height_m":{"type":"array"},"sigma_m":{"type":"array"}}}},
"alarm":{"type":"object","properties":{"level":{"type":"string","enum":["off","clear","warning","alarm"]},"rule":{"type":["string","null"]},"track":{"type":["integer","null"]},"changed":{"type":"boolean"},"nearest_m":{"type":["number","null"]},"time_to_collision_s":{"type":["number","null"]},"required_deceleration_m_s2":{"type":["number","null"]},"reason":{"type":"string","description":"Why it has this level, in words"},"object":{"type":["object","null"],"description":"What it is about: the object that raised the level, or else the nearest in the path","properties":{"track":{"type":"integer"},"class":{"type":["string","null"]},"clearance_m":{"type":["number","null"],"description":"Gap to the path when the vehicle arrives; negative where they overlap"}}}}},
"obstacles":{"type":"array","items":{"type":"object","properties":{
"track":{"type":"integer"},"class":{"type":"string"},"score":{"type":["number","null"]},"confirmed":{"type":"boolean"},
"x_px":{"type":"integer"},"y_px":{"type":"integer"},"width_px":{"type":"integer"},"height_px":{"type":"integer"},
"distance_m":{"type":"number"},"distance_sigma_m":{"type":"number"},"lateral_m":{"type":"number"},"width_m":{"type":"number"},"height_m":{"type":"number"},"clearance_m":{"type":["number","null"],"description":"Gap to the path when the vehicle arrives; negative where they overlap"},
"missed":{"type":"integer"},"predicted":{"type":"boolean","description":"nothing was seen of it in this frame: box, place and size are predictions"},"probability":{"type":"number","description":"that it exists"},"in_path":{"type":"boolean"},"across_m_s":{"type":["number","null"]},
"closing_m_s":{"type":["number","null"]},"closing_sigma_m_s":{"type":["number","null"]},"time_to_collision_s":{"type":["number","null"]},"time_to_collision_sigma_s":{"type":["number","null"]}}}}}}"#,
};

/// `lookout.Status`: what `lookout status --json` prints.
pub const STATUS: Schema = Schema::Json {
    name: "lookout.Status",
    text: r#"{"title":"lookout.Status","type":"object","description":"How the daemon is doing: what lookout status --json prints",
"properties":{
"pid":{"type":"integer"},"state":{"type":"string"},"reason":{"type":"string"},"uptime_s":{"type":"number"},"frames":{"type":"integer"},
"latency_p50_ms":{"type":"number"},"latency_p99_ms":{"type":"number"},"alarm":{"type":"string"},"alarm_rule":{"type":["string","null"]},"alarm_reason":{"type":"string"},"alarm_object":{"type":["object","null"]},"alarm_times":{"type":"object","description":"Frames and seconds by level, and why it was off"},"alarms":{"type":"integer"},
"obstacles":{"type":"integer"},"nearest_m":{"type":["number","null"]},"free_ahead_m":{"type":["number","null"]},"boundaries":{"type":"integer"},
"motion":{"type":"object","properties":{"known":{"type":"boolean"},"sources":{"type":"array"},"speed_m_s":{"type":["number","null"]},"yaw_rate_rad_s":{"type":["number","null"]}}},
"calibration":{"type":"object","properties":{"state":{"type":"string"},"text":{"type":"string"},"typical_px":{"type":"number"},"lost":{"type":"number"},"moved":{"type":"boolean"}}},
"processes":{"type":"array","items":{"type":"object","properties":{
"role":{"type":"string"},"state":{"type":"string"},"pid":{"type":"integer"},"restarts":{"type":"integer"},"frames":{"type":"integer"},
"skipped":{"type":"integer"},"refused":{"type":"integer"},"rate_hz":{"type":"number"},"p50_ms":{"type":"number"},"p99_ms":{"type":"number"},
"cpu_percent":{"type":"number"},"private_bytes":{"type":"integer"},"shared_bytes":{"type":"integer"}}}}}}"#,
};

/// `lookout.Loss`.
pub const LOSS: Schema = Schema::Json {
    name: "lookout.Loss",
    text: r#"{"title":"lookout.Loss","type":"object","description":"Messages that were sent and could not be recorded",
"properties":{
"service":{"type":"string","description":"The service that sent them; disk: the disk was too slow for what had been received"},
"count":{"type":"integer","description":"How many since the last such message"},
"total":{"type":"integer","description":"How many since the recording began"}}}"#,
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_schemas_are_json() {
        for schema in [PAIR, VEHICLE, OBSTACLES, STATUS, LOSS] {
            let value: serde_json::Value = serde_json::from_slice(schema.data()).unwrap();
            assert_eq!(value["title"], schema.name());
            assert!(value["properties"].as_object().unwrap().len() > 2);
        }
    }
}
