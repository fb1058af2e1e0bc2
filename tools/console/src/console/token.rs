//! The token in the page's address.

use std::net::IpAddr;

use anyhow::Context;

/// Who may have the page.
#[derive(Clone, Debug)]
pub struct Access {
    /// `None`: whoever is on this machine.
    token: Option<String>,
}

impl Access {
    /// On a loopback address nobody needs a token.
    pub fn at(address: IpAddr) -> anyhow::Result<Access> {
        if address.is_loopback() {
            return Ok(Access { token: None });
        }
        let mut random = [0; 16];
        getrandom::fill(&mut random).ok().context("the system gives no random bytes")?;
        Ok(Access { token: Some(random.iter().map(|byte| format!("{byte:02x}")).collect()) })
    }

    /// What stands behind the address.
    pub fn query(&self) -> String {
        self.token.as_ref().map_or(String::new(), |token| format!("?token={token}"))
    }

    /// Whether a request may be answered, by its token and by the host that it names. A page of another site can have
    /// its name stand for this address; so only numbers and `localhost` are taken.
    pub fn allows(&self, token: Option<&str>, host: Option<&str>) -> bool {
        match &self.token {
            Some(wanted) => token.is_some_and(|token| is_same(token, wanted)),
            None => host.is_some_and(is_number),
        }
    }
}

/// Compares in a time that does not tell where two tokens differ.
fn is_same(a: &str, b: &str) -> bool {
    let difference = a.bytes().zip(b.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
    a.len() == b.len() && difference == 0
}

fn is_number(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or(""),
        None => host.split(':').next().unwrap_or(""),
    };
    name == "localhost" || name.parse::<IpAddr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_needs_no_token_but_a_host_that_is_a_number() {
        let access = Access::at("127.0.0.1".parse().unwrap()).unwrap();
        assert_eq!(access.query(), "");
        for host in ["127.0.0.1:8080", "localhost:9", "[::1]:80", "localhost"] {
            assert!(access.allows(None, Some(host)), "{host}");
        }
        for host in [Some("evil.example:8080"), Some(""), None] {
            assert!(!access.allows(None, host), "{host:?}");
        }
    }

    #[test]
    fn other_addresses_need_their_own_token() {
        let access = Access::at("0.0.0.0".parse().unwrap()).unwrap();
        let token = access.query().strip_prefix("?token=").unwrap().to_owned();
        assert_eq!(token.len(), 32);
        assert!(access.allows(Some(&token), Some("boat.example")));
        let other = Access::at("0.0.0.0".parse().unwrap()).unwrap();
        assert!(!other.allows(Some(&token), Some("127.0.0.1")));
        for token in [None, Some(""), Some(&token[1..])] {
            assert!(!access.allows(token, Some("127.0.0.1")));
        }
    }
}
