//! Addresses on the command line, and sockets.

use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::time::Duration;

/// Longest datagram.
pub const DATAGRAM: usize = 1 << 16;

#[derive(Debug, thiserror::Error)]
pub enum EndpointError {
    #[error(
        "UDP port {0}: it cannot be listened on: {1}; another program may have it, so choose another one"
    )]
    Bind(SocketAddr, std::io::Error),
    #[error("{0}: datagrams cannot be sent there: {1}")]
    Connect(SocketAddr, std::io::Error),
}

/// `PORT`, on all addresses of this machine, or `ADDRESS:PORT`.
pub fn local(text: &str) -> Result<SocketAddr, String> {
    match text.parse() {
        Ok(port) => Ok((Ipv4Addr::UNSPECIFIED, port).into()),
        Err(_) => remote(text).map_err(|_| "must be PORT or ADDRESS:PORT".into()),
    }
}

/// `ADDRESS:PORT`, the address also by its name.
pub fn remote(text: &str) -> Result<SocketAddr, String> {
    let found = text.to_socket_addrs().ok().and_then(|mut all| all.next());
    found.ok_or("must be ADDRESS:PORT".into())
}

pub fn listen(at: SocketAddr) -> Result<UdpSocket, EndpointError> {
    UdpSocket::bind(at).map_err(|error| EndpointError::Bind(at, error))
}

/// A socket that sends to one address, and takes datagrams from it alone.
pub fn connect(to: SocketAddr) -> Result<UdpSocket, EndpointError> {
    let any = match to {
        SocketAddr::V4(_) => SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)),
        SocketAddr::V6(_) => SocketAddr::from((std::net::Ipv6Addr::UNSPECIFIED, 0)),
    };
    let socket = UdpSocket::bind(any).map_err(|error| EndpointError::Bind(any, error))?;
    socket.connect(to).map_err(|error| EndpointError::Connect(to, error))?;
    Ok(socket)
}

/// The next datagram within a time, or without it one that waits; `None`: none. That nobody listens at the other end is
/// no failure: it may do so later.
pub fn receive<'a>(
    socket: &UdpSocket,
    within: Option<Duration>,
    into: &'a mut [u8],
) -> std::io::Result<Option<(&'a [u8], SocketAddr)>> {
    use std::io::ErrorKind::{ConnectionRefused, Interrupted, TimedOut, WouldBlock};
    // A timeout of zero would be none.
    socket.set_read_timeout(within.map(|within| within.max(Duration::from_millis(1))))?;
    socket.set_nonblocking(within.is_none())?;
    let received = socket.recv_from(into);
    // What is sent must wait for room.
    socket.set_nonblocking(false)?;
    match received {
        Ok((len, from)) => Ok(Some((&into[..len], from))),
        Err(error) => match error.kind() {
            WouldBlock | TimedOut | Interrupted | ConnectionRefused => Ok(None),
            _ => Err(error),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_on_all_addresses() {
        assert_eq!(local("5600").unwrap(), "0.0.0.0:5600".parse().unwrap());
        assert_eq!(local("127.0.0.1:80").unwrap(), "127.0.0.1:80".parse().unwrap());
        assert_eq!(remote("[::1]:9").unwrap(), "[::1]:9".parse().unwrap());
        for text in ["", "70000", "x", "127.0.0.1"] {
            assert!(local(text).is_err(), "{text}");
        }
        assert!(remote("5600").is_err());
    }
}
