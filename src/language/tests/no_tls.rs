//! What lines of TLS say where there is none. Run by `cargo test -p mobgate --lib --no-default-features --features ipv6`.

use super::{PORTS, error_after};

#[test]
fn lines_that_need_tls_are_refused_and_change_nothing() {
    for line in [
        "certificate gateway own /tls/gw.pem key /tls/gw.key",
        "port secure tcp server 802 tls",
        "edit port P502 tls",
        "port inverter tcp client 192.168.1.20:802 tls",
        "route P502 1 * * P1 role operator",
    ] {
        let said = error_after(PORTS, line);
        assert!(said.ends_with(": this board has no TLS"), "{line}: {said}");
    }
}
