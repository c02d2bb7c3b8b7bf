//! All messages. To add one, write a module and add it to the list below.

use crate::pipeline::Kind;
use crate::typed::Message;

macro_rules! messages {
    ($($module:ident::$message:ident,)*) => {
        $(pub mod $module;)*

        /// Maximum length of the payload of a kind of message for images of `width` × `height` pixels, in bytes.
        pub(crate) fn max_payload_bytes(kind: Kind, width: usize, height: usize) -> usize {
            match kind {
                $(<$module::$message as Message>::KIND => $module::$message::max_payload_bytes(width, height),)*
            }
        }
    };
}

pub mod track;

messages! {
    pair::PairMessage,
    depth::DepthMessage,
    regions::RegionsMessage,
    obstacles::ObstaclesMessage,
    report::ReportMessage,
    command::CommandMessage,
    status::StatusMessage,
}
