//! Access control: the token, and protection from requests that other web pages make a browser send.

use super::request::Request;
use std::fs::File;
use std::io::{self, Read};
use std::net::{IpAddr, SocketAddr};
use std::path::Path;
use thiserror::Error;

/// Minimum length of a token.
const MIN_LENGTH: usize = 16;

/// Maximum length of a token.
const MAX_LENGTH: usize = 128;

/// Random bytes of a generated token.
const RANDOM_BYTES: usize = 16;

/// Why there is no token.
#[derive(Debug, Error)]
pub enum TokenError {
    /// It is too short, too long, or has characters that need escaping in a link.
    #[error(
        "--token: give {MIN_LENGTH} to {MAX_LENGTH} letters, digits, - and _ (without --token one is generated if it \
         is needed)"
    )]
    Unfit,
    /// Its file cannot be read.
    #[error("--token @{path}: {source}")]
    File {
        /// The file.
        path: String,
        /// The error.
        source: io::Error,
    },
    /// The system has no random numbers.
    #[error("/dev/urandom: {0}")]
    Random(io::Error),
}

/// The token of the command line; `@FILE` reads it from a file.
///
/// # Errors
/// If it is not a valid token, or its file cannot be read.
pub fn given_token(text: &str) -> Result<String, TokenError> {
    let token = match text.strip_prefix('@') {
        Some(path) => std::fs::read_to_string(Path::new(path))
            .map_err(|source| TokenError::File { path: path.to_owned(), source })?
            .trim()
            .to_owned(),
        None => text.to_owned(),
    };
    let fit = |c: u8| c.is_ascii_alphanumeric() || c == b'-' || c == b'_';
    let is_fit = (MIN_LENGTH..=MAX_LENGTH).contains(&token.len()) && token.bytes().all(fit);
    if is_fit { Ok(token) } else { Err(TokenError::Unfit) }
}

/// A new token of 128 random bits.
///
/// # Errors
/// If the system has no random numbers.
pub fn new_token() -> Result<String, TokenError> {
    let mut bytes = [0_u8; RANDOM_BYTES];
    File::open("/dev/urandom").and_then(|mut f| f.read_exact(&mut bytes)).map_err(TokenError::Random)?;
    Ok(bytes.iter().map(|b| format!("{b:02x}")).collect())
}

/// Decision on a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is authorised.
    Welcome,
    /// It is authorised by the token in its link. The page is redirected and uses a cookie from then on, so
    /// that the token does not stay in the address bar.
    WelcomeByLink,
    /// It has no token, or a wrong one.
    NoToken,
    /// It was caused by another web page (cross-origin, or DNS rebinding).
    Foreign,
}

/// The access rules of a server.
#[derive(Clone, Debug)]
pub struct Access {
    token: Option<String>,
    address: IpAddr,
    /// Cookies of one host are shared by all its ports.
    cookie: String,
}

impl Access {
    /// The rules for a server at `address`. Without a token everyone who can reach it has access.
    pub fn new(address: SocketAddr, token: Option<String>) -> Self {
        Self { token, address: address.ip(), cookie: format!("lookout-{}", address.port()) }
    }

    /// Decides on a request.
    ///
    /// A foreign web page can make a browser send requests to this server, and by resolving its own name
    /// to this address (DNS rebinding) even read the responses. `Host` then contains the foreign name, so
    /// without a token only names of this machine are accepted. With a token the name does not matter,
    /// because the browser sends the cookie only to the name that set it. `Origin`, if present, must be
    /// the page of this server.
    pub fn judge(&self, request: &Request) -> Verdict {
        if request.origin.as_deref().is_some_and(|origin| !is_own(origin, &request.host)) {
            return Verdict::Foreign;
        }
        let Some(token) = &self.token else {
            return if self.is_this_machine(&request.host) { Verdict::Welcome } else { Verdict::Foreign };
        };
        let matches = |given: Option<&str>| given.is_some_and(|given| is_equal(given, token));
        if matches(request.query_value("token")) {
            return Verdict::WelcomeByLink;
        }
        let bearer = request.authorization.as_deref().and_then(|a| a.strip_prefix("Bearer "));
        if matches(request.cookie(&self.cookie)) || matches(bearer) {
            Verdict::Welcome
        } else {
            Verdict::NoToken
        }
    }

    /// The `Set-Cookie` value that holds the token; `None` without a token.
    pub fn set_cookie(&self) -> Option<String> {
        let token = self.token.as_ref()?;
        Some(format!("{}={token}; Path=/; HttpOnly; SameSite=Strict", self.cookie))
    }

    fn is_this_machine(&self, host: &str) -> bool {
        let name = without_port(host);
        let address = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
        match address {
            Ok(address) => address.is_loopback() || address == self.address,
            Err(_) => name.eq_ignore_ascii_case("localhost"),
        }
    }
}

fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) && !name.ends_with(':') => name,
        _ => host,
    }
}

/// Whether an origin is the page served under this host name.
fn is_own(origin: &str, host: &str) -> bool {
    let name = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    name.is_some_and(|name| name.eq_ignore_ascii_case(host))
}

/// Compares in a time that does not depend on how many characters match (timing attacks).
fn is_equal(given: &str, token: &str) -> bool {
    let (given, token) = (given.as_bytes(), token.as_bytes());
    let differences = token.iter().enumerate().fold(0_u8, |found, (i, byte)| {
        let other = given.get(i).copied().unwrap_or(0);
        std::hint::black_box(found | (byte ^ other))
    });
    differences == 0 && given.len() == token.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "0123456789abcdef";

    fn request(head: &str) -> Request {
        let text = format!("GET /{head}\r\n\r\n");
        Request::parse(text.as_bytes()).unwrap().unwrap()
    }

    fn judge(token: Option<&str>, head: &str) -> Verdict {
        let address = "127.0.0.1:8467".parse().unwrap();
        Access::new(address, token.map(str::to_owned)).judge(&request(head))
    }

    #[test]
    fn without_a_token_only_names_of_this_machine_are_answered() {
        for host in ["127.0.0.1:8467", "localhost:8467", "LOCALHOST", "[::1]:8467", "[::1]", "127.0.0.1"] {
            assert_eq!(judge(None, &format!(" HTTP/1.1\r\nHost: {host}")), Verdict::Welcome, "{host}");
        }
        for host in ["evil.example", "evil.example:8467", "192.168.1.4:8467", "localhost.evil.example", ""] {
            assert_eq!(judge(None, &format!(" HTTP/1.1\r\nHost: {host}")), Verdict::Foreign, "{host}");
        }
    }

    #[test]
    fn foreign_pages_are_rejected() {
        let from = |origin: &str| judge(None, &format!(" HTTP/1.1\r\nHost: localhost:1\r\nOrigin: {origin}"));
        assert_eq!(from("http://localhost:1"), Verdict::Welcome);
        for origin in ["http://evil.example", "http://localhost:2", "null", "http://localhost:1.evil.example"]
        {
            assert_eq!(from(origin), Verdict::Foreign, "{origin}");
        }
        let known = format!(
            " HTTP/1.1\r\nHost: car:1\r\nOrigin: http://evil.example\r\nCookie: lookout-8467={TOKEN}"
        );
        assert_eq!(judge(Some(TOKEN), &known), Verdict::Foreign);
    }

    #[test]
    fn the_token_comes_by_link_cookie_or_header() {
        let head = |more: &str| format!(" HTTP/1.1\r\nHost: car.local:8467\r\n{more}");
        assert_eq!(judge(Some(TOKEN), &head("X: y")), Verdict::NoToken);
        let link = format!("?token={TOKEN} HTTP/1.1\r\nHost: car.local");
        assert_eq!(judge(Some(TOKEN), &link), Verdict::WelcomeByLink);
        let cookie = format!("Cookie: a=b; lookout-8467={TOKEN}; c=d");
        assert_eq!(judge(Some(TOKEN), &head(&cookie)), Verdict::Welcome);
        let bearer = format!("Authorization: Bearer {TOKEN}");
        assert_eq!(judge(Some(TOKEN), &head(&bearer)), Verdict::Welcome);
        for wrong in ["", "0123456789abcdeF", "0123456789abcde", "0123456789abcdef0", "0123456789abcdef\0"] {
            assert!(!is_equal(wrong, TOKEN), "{wrong:?}");
        }
    }

    #[test]
    fn tokens_are_random_and_fit() {
        let (a, b) = (new_token().unwrap(), new_token().unwrap());
        assert!(a != b && a.len() == 2 * RANDOM_BYTES);
        assert_eq!(given_token(&a).unwrap(), a);
        for unfit in
            ["short", "with spaces in it, long", "quote\"quote\"quote\"", &"x".repeat(MAX_LENGTH + 1)]
        {
            assert!(matches!(given_token(unfit), Err(TokenError::Unfit)), "{unfit}");
        }
        assert!(given_token("@/no/such/file").unwrap_err().to_string().contains("/no/such/file"));
    }
}
