//! Names of the types of messages, as they stand in shared memory: another program, of whatever language or compiler,
//! opens a service only if its own names are the same. They change with [`VERSION`].

use crate::pipeline::{ServiceSpec, VERSION};

/// Name of the header's type.
pub(crate) const HEADER: &str = {
    const TEXT: [u8; HEADER_BYTES] = with_version(*b"lookout.header.v");
    match std::str::from_utf8(&TEXT) {
        Ok(text) => text,
        Err(_) => panic!("ASCII"),
    }
};

/// Name of the type of a payload's lines. They have no fields, so their layout never changes.
pub(crate) const LINE: &str = "lookout.line.v1";

/// Key of the attribute of a service with the name of its message, [`of_service`].
pub(crate) const ATTRIBUTE: &str = "lookout.message";

/// Name of the message of a service, `lookout.<service>.v<version>`.
pub fn of_service(spec: &ServiceSpec) -> String {
    format!("lookout.{}.v{VERSION}", spec.name)
}

/// `lookout.header.v` has this length, and the version the rest.
const HEADER_BYTES: usize = 16 + digits(VERSION);

const fn digits(number: u16) -> usize {
    match number {
        0..10 => 1,
        10..100 => 2,
        100..1000 => 3,
        1000..10_000 => 4,
        _ => 5,
    }
}

/// A text with [`VERSION`] appended.
const fn with_version<const N: usize, const M: usize>(text: [u8; N]) -> [u8; M] {
    let mut all = [0; M];
    let (mut at, mut rest) = (M, VERSION);
    while at > N {
        at -= 1;
        all[at] = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    while at > 0 {
        at -= 1;
        all[at] = text[at];
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::header::{Header, Line};
    use iceoryx2::prelude::ZeroCopySend;

    #[test]
    fn names_are_stable_and_hold_the_version() {
        // SAFETY: the names are only compared.
        let names = unsafe { (<Header as ZeroCopySend>::type_name(), <Line as ZeroCopySend>::type_name()) };
        assert_eq!(names, (&format!("lookout.header.v{VERSION}")[..], "lookout.line.v1"));
        assert_eq!(of_service(&crate::service::OBSTACLES), format!("lookout.obstacles.v{VERSION}"));
        assert_eq!([0, 9, 10, 999, 1000, u16::MAX].map(digits), [1, 1, 2, 3, 4, 5]);
    }
}
