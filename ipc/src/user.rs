//! Names of the machine's users, for texts.

use std::fs::File;
use std::io::Read;

/// Where the local users are listed.
const PASSWD: &str = "/etc/passwd";

/// Maximum number of bytes that are read of it.
const MAX_PASSWD_BYTES: u64 = 1 << 20;

/// The name of a local user; `None` for one that is known only elsewhere, or not at all.
pub fn name(user: u32) -> Option<String> {
    let mut text = Vec::new();
    File::open(PASSWD).ok()?.take(MAX_PASSWD_BYTES).read_to_end(&mut text).ok()?;
    name_in(&String::from_utf8_lossy(&text), user)
}

/// The user for people: name and number, or the number alone.
pub fn told(user: u32) -> String {
    name(user).map_or_else(|| user.to_string(), |name| format!("{name} ({user})"))
}

/// The user as `sudo -u` takes it: by name, or by number.
pub fn for_sudo(user: u32) -> String {
    name(user).unwrap_or_else(|| format!("'#{user}'"))
}

fn name_in(passwd: &str, user: u32) -> Option<String> {
    let entry = passwd.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(user)).then_some(name)
    })?;
    // Nothing that a shell or a terminal would take for more than a name.
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    (!entry.is_empty() && entry.chars().all(is_plain)).then(|| entry.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn users_are_named_where_the_list_knows_them() {
        let passwd =
            "root:x:0:0:root:/root:/bin/sh\nlookout:x:998:998::/:/bin/false\nbroken\n$(id):x:5:5::/:\n";
        assert_eq!(name_in(passwd, 998).as_deref(), Some("lookout"));
        assert_eq!((name_in(passwd, 5), name_in(passwd, 7)), (None, None));
        assert_eq!((name_in("", 0), for_sudo(u32::MAX - 1)), (None, "'#4294967294'".to_owned()));
    }
}
