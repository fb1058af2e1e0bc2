//! The tokens in the page's addresses.

use std::net::IpAddr;

use anyhow::Context;

/// Who may have the page.
#[derive(Clone, Debug)]
pub struct Access {
    /// The pilot's, and that of those who only look. `None`: whoever is on this machine.
    tokens: Option<[String; 2]>,
}

/// What a request may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    Pilot,
    /// Looks, and changes nothing.
    View,
}

impl Access {
    /// On a loopback address nobody needs a token.
    pub fn at(address: IpAddr) -> anyhow::Result<Access> {
        if address.is_loopback() {
            return Ok(Access { tokens: None });
        }
        Ok(Access { tokens: Some([random()?, random()?]) })
    }

    /// What stands behind the pilot's address, and, with tokens, behind that of those who only look.
    pub fn queries(&self) -> Vec<String> {
        let Some([pilot, view]) = &self.tokens else { return vec![String::new()] };
        vec![format!("?token={pilot}"), format!("?view&token={view}")]
    }

    /// What a request may do, by its token and by the host that it names; `None`: nothing. A page of another site can
    /// have its name stand for this address; so only numbers and `localhost` are taken.
    pub fn role(&self, token: Option<&str>, host: Option<&str>) -> Option<Role> {
        let Some([pilot, view]) = &self.tokens else {
            return host.is_some_and(is_number).then_some(Role::Pilot);
        };
        let token = token?;
        let roles = [(pilot, Role::Pilot), (view, Role::View)];
        roles.into_iter().find(|(wanted, _)| is_same(token, wanted)).map(|(_, role)| role)
    }
}

fn random() -> anyhow::Result<String> {
    let mut random = [0; 16];
    getrandom::fill(&mut random).ok().context("the system gives no random bytes")?;
    Ok(random.iter().map(|byte| format!("{byte:02x}")).collect())
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
        assert_eq!(access.queries(), [""]);
        for host in ["127.0.0.1:8080", "localhost:9", "[::1]:80", "localhost"] {
            assert_eq!(access.role(None, Some(host)), Some(Role::Pilot), "{host}");
        }
        for host in [Some("evil.example:8080"), Some(""), None] {
            assert_eq!(access.role(None, host), None, "{host:?}");
        }
    }

    #[test]
    fn other_addresses_need_their_own_token() {
        let access = Access::at("0.0.0.0".parse().unwrap()).unwrap();
        let [pilot, view] = access.queries().try_into().unwrap();
        let token = pilot.strip_prefix("?token=").unwrap();
        assert_eq!(token.len(), 32);
        let role = |token: Option<&str>| access.role(token, Some("boat.example"));
        assert_eq!(role(Some(token)), Some(Role::Pilot));
        assert_eq!(role(view.strip_prefix("?view&token=")), Some(Role::View));
        let other = Access::at("0.0.0.0".parse().unwrap()).unwrap();
        assert_eq!(other.role(Some(token), Some("127.0.0.1")), None);
        for token in [None, Some(""), Some(&token[1..])] {
            assert_eq!(role(token), None);
        }
    }
}
