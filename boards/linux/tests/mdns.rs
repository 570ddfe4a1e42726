//! The gateway as it is found on the network by somebody else's multicast DNS, in a network of the test's own.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::Duration;

use mobgate_simulator::own_network::{MASTER_END, in_own_network, ip, python};

use common::{PATIENCE, converse, with_console};

mod common;

/// Somebody who looks for Modbus TCP servers.
struct Browser {
    child: Child,
    seen: Receiver<String>,
}

impl Browser {
    /// In the network of this address of the machine.
    fn at(address: &str) -> Self {
        let mut command = Command::new(python("zeroconf"));
        command
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peers/browse.py"))
            .arg(address)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let (tell, seen) = channel();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        thread::spawn(move || lines.map_while(Result::ok).try_for_each(|line| tell.send(line)));
        Self { child, seen }
    }

    fn next(&self) -> String {
        self.seen
            .recv_timeout(PATIENCE)
            .expect("something is found: cargo xtask install peers brings zeroconf")
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The interface's network is 10.5.`net`.0/24 now.
fn address(net: u8, interface: &str) {
    ip(&format!("addr add 10.5.{net}.1/24 dev {interface}"));
}

#[test]
fn servers_are_found_by_the_gateways_name_until_it_is_switched_off() {
    in_own_network("servers_are_found_by_the_gateways_name_until_it_is_switched_off", || {
        address(1, MASTER_END);
        let lines = "mdns on name cabinet-7\nport P502 tcp server {port}\nport own tcp server 127.0.0.1:1\n";
        let program = with_console(lines);
        let port = program.port;
        program.logs("found on the network as cabinet-7");
        let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
        let host = host.split('.').next().unwrap().replace('_', "-");

        let browser = Browser::at("10.5.1.1");
        let found =
            |name: &str, net: u8| format!("found {name} 10.5.{net}.1 {port} {host}-mobgate.local. mobgate");
        assert_eq!(browser.next(), found("cabinet-7", 1));
        let mut session = program.session();
        converse(&mut session, "mdns on name press-2\nsave\nshow version\n", "Linux");
        let mut news = [browser.next(), browser.next()];
        news.sort();
        assert_eq!(news, [found("press-2", 1), "gone cabinet-7".to_owned()]);

        // A network that comes later. Who looks there hears what this machine says in the other one, too.
        drop(browser);
        ip("link add late type veth peer name unused");
        ip("link set unused up");
        ip("link set late up");
        address(2, "late");
        let browser = Browser::at("10.5.2.1");
        let news = browser.next();
        assert!(news.starts_with("found press-2 ") && news.contains(" 10.5.2.1 "), "{news}");

        writeln!(session, "mdns off").unwrap();
        while browser.next() != "gone press-2" {}
        drop(browser);
        let nothing = Browser::at("10.5.1.1").seen.recv_timeout(Duration::from_secs(3));
        assert!(nothing.is_err(), "{nothing:?}");
    });
}
