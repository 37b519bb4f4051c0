//! Who may look: a token that only the reader of the program's output knows, and requests that come
//! to this machine under its own name.

use axum::http::{HeaderMap, header};

/// Secret of one server. Its text is 64 hexadecimal digits.
#[derive(Clone, PartialEq, Eq)]
pub struct Token {
    text: String,
    /// Name of the cookie: servers on other ports of the same host have other names, because a
    /// browser sends cookies to all ports.
    cookie: String,
}

/// Answer to a request's credentials.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// The token is right.
    Granted,
    /// There is no token.
    Missing,
    /// The token is another one.
    Wrong,
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(…)")
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

impl Token {
    /// A new token from the operating system's random numbers.
    ///
    /// # Errors
    /// The operating system has none.
    pub fn random() -> std::io::Result<Self> {
        let (mut secret, mut name) = ([0; 32], [0; 4]);
        getrandom::fill(&mut secret)?;
        getrandom::fill(&mut name)?;
        Ok(Self {
            text: hex(&secret),
            cookie: format!("cardiotwin-{}", hex(&name)),
        })
    }

    /// The token's text, for an address.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Whether `given` is this token. The time does not depend on the place of the first difference.
    #[must_use]
    pub fn is(&self, given: &str) -> bool {
        let (own, given) = (self.text.as_bytes(), given.as_bytes());
        let differences = std::iter::zip(own, given).fold(0, |all, (a, b)| all | (a ^ b));
        own.len() == given.len() && std::hint::black_box(differences) == 0
    }

    /// Value of the header that hands the token to a browser. Scripts cannot read it, and requests
    /// from other sites do not carry it.
    #[must_use]
    pub fn set_cookie(&self) -> String {
        format!(
            "{}={}; Path=/; HttpOnly; SameSite=Strict",
            self.cookie, self.text
        )
    }

    /// Access by the cookie of a request.
    #[must_use]
    pub fn access(&self, headers: &HeaderMap) -> Access {
        let cookies = headers.get_all(header::COOKIE).iter();
        let mut own = cookies
            .filter_map(|line| line.to_str().ok())
            .flat_map(|line| line.split(';'))
            .filter_map(|pair| pair.trim().split_once('='))
            .filter(|(name, _)| *name == self.cookie);
        match own.next() {
            None => Access::Missing,
            Some((_, value)) if self.is(value) => Access::Granted,
            Some(_) => Access::Wrong,
        }
    }
}

/// Whether a request is addressed to this machine's loopback. The port is free, since a tunnel may
/// begin at another one. A page of a foreign host whose name was made to point here sends that name.
#[must_use]
pub fn is_local(headers: &HeaderMap) -> bool {
    let mut hosts = headers.get_all(header::HOST).iter();
    let (Some(Ok(host)), None) = (hosts.next().map(|host| host.to_str()), hosts.next()) else {
        return false;
    };
    let (name, port) = match host.rsplit_once(':') {
        Some((name, port)) if !port.contains(']') => (name, Some(port)),
        _ => (host, None),
    };
    port.is_none_or(|port| port.parse::<u16>().is_ok())
        && ["127.0.0.1", "localhost", "[::1]"].contains(&name)
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn headers(name: header::HeaderName, values: &[&str]) -> HeaderMap {
        let mut map = HeaderMap::new();
        for value in values {
            map.append(name.clone(), HeaderValue::from_str(value).unwrap());
        }
        map
    }

    #[test]
    fn tokens_differ_and_only_the_whole_one_counts() {
        let (one, other) = (Token::random().unwrap(), Token::random().unwrap());
        assert!(one.is(one.text()) && !one.is(other.text()));
        assert!(!one.is("") && !one.is(&one.text()[1..]) && !one.is(&format!("{}0", one.text())));
        assert_eq!(one.text().len(), 64);
        assert_eq!(format!("{one:?}"), "Token(…)");
    }

    #[test]
    fn the_cookie_is_found_among_others() {
        let (one, other) = (Token::random().unwrap(), Token::random().unwrap());
        let pair = one.set_cookie().split(';').next().unwrap().to_owned();
        let access = |values: &[&str]| one.access(&headers(header::COOKIE, values));
        assert_eq!(access(&[]), Access::Missing);
        assert_eq!(access(&["a=b"]), Access::Missing);
        assert_eq!(access(&[&other.set_cookie()]), Access::Missing);
        assert_eq!(access(&[&format!("a=b; {pair}; c=d")]), Access::Granted);
        assert_eq!(access(&["a=b", &pair]), Access::Granted);
        assert_eq!(access(&[&format!("{pair}0")]), Access::Wrong);
    }

    #[test]
    fn only_names_of_this_machine_are_local() {
        for host in [
            "127.0.0.1",
            "127.0.0.1:8080",
            "localhost:1",
            "[::1]:80",
            "[::1]",
        ] {
            assert!(is_local(&headers(header::HOST, &[host])), "{host}");
        }
        for host in [
            "evil.example",
            "evil.example:80",
            "127.0.0.1.evil.example",
            "localhost:x",
            "0.0.0.0",
            "",
        ] {
            assert!(!is_local(&headers(header::HOST, &[host])), "{host}");
        }
        assert!(!is_local(&headers(header::HOST, &[])));
        assert!(!is_local(&headers(
            header::HOST,
            &["localhost", "evil.example"]
        )));
    }
}
