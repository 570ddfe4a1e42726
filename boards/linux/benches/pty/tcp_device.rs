//! A Modbus TCP server that answers every request at once, as the line's units do.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::thread;

use crate::line::response_to;

/// MBAP header and FC 3.
const REQUEST_BYTES: usize = 7 + 5;

/// Starts it, and gives its port. It lives as long as the process.
pub(crate) fn start() -> u16 {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            thread::spawn(move || serve(stream));
        }
    });
    port
}

fn serve(mut stream: TcpStream) -> io::Result<()> {
    stream.set_nodelay(true)?;
    loop {
        let mut request = [0; REQUEST_BYTES];
        stream.read_exact(&mut request)?;
        let pdu = response_to(u16::from_be_bytes([request[8], request[9]]));
        let head = [request[0], request[1], 0, 0, 0, 1 + pdu.len() as u8, request[6]];
        stream.write_all(&[&head[..], &pdu].concat())?;
    }
}
