//! The settings of each gateway, in its own language.

use std::path::Path;

use super::{Behind, Wired};

pub(super) fn mobgate(behind: Behind<'_>, port: u16) -> String {
    let client = match behind {
        Behind::Line(Wired { device, pace, timeout_ms }) => {
            let gap = if pace.silence.is_zero() { "gap 0ms" } else { "" };
            // What is measured begins when the line is ready, not while it discards what comes at its start.
            format!(
                "serial {device} rtu client {} 8N2 timeout {timeout_ms}ms late-window 100ms {gap}",
                pace.baud
            )
        }
        Behind::Tcp(server) => format!("tcp client 127.0.0.1:{server} in-flight 16"),
    };
    format!("port P1 {client}\nport P502 tcp server 127.0.0.1:{port} clients 64\nroute P502 * * * P1\n")
}

pub(super) fn mbusd(Wired { device, pace, timeout_ms }: Wired<'_>, port: u16) -> String {
    format!(
        "device = {device}\nspeed = {}\nmode = 8n2\naddress = 127.0.0.1\nport = {port}\nmaxconn = 64\nretries = 0\n\
         wait = {timeout_ms}\n",
        pace.baud
    )
}

/// It gives up when it has waited three times for a byte. What it calls flushing drops the request that a PTY still holds.
pub(super) fn modbus_relay(
    Wired { device, pace, timeout_ms }: Wired<'_>,
    port: u16,
    folder: &Path,
) -> String {
    format!(
        "tcp: {{bind_addr: 127.0.0.1, bind_port: {port}, keep_alive: 60s}}\n\
         rtu: {{device: {device}, baud_rate: {}, data_bits: 8, parity: none, stop_bits: two, flush_after_write: false, \
         rts_type: none, rts_delay_us: 0, transaction_timeout: 5s, serial_timeout: {}ms, max_frame_size: 256}}\n\
         http: {{enabled: false, bind_addr: 127.0.0.1, bind_port: 0, metrics_enabled: false}}\n\
         logging: {{log_dir: {}, level: error, trace_frames: false, format: json, include_location: false, \
         thread_ids: false, thread_names: false}}\n\
         connection: {{max_connections: 100, per_ip_limits: 100, idle_timeout: 60s, error_timeout: 300s, \
         connect_timeout: 5s, backoff: {{initial_interval: 100ms, max_interval: 30s, multiplier: 2.0, max_retries: 5}}}}\n",
        pace.baud,
        timeout_ms / 3,
        folder.display()
    )
}

/// It takes ranges of units, too, and does not use them.
pub(super) fn modbus_gateway(behind: Behind<'_>, port: u16) -> String {
    let downstream = match behind {
        Behind::Line(Wired { device, pace, timeout_ms }) => format!(
            "type = \"serial\"\nport = \"{device}\"\nmode = \"rtu\"\nbaud_rate = {}\nstop_bits = 2\n\
             response_timeout_ms = {timeout_ms}\n",
            pace.baud
        ),
        Behind::Tcp(server) => format!("type = \"tcp\"\naddress = \"127.0.0.1:{server}\"\n"),
    };
    let route = |unit| format!("[[route]]\ntype = \"unit\"\nunit_id = {unit}\ndownstream = \"devices\"\n");
    let routes: String = (1..=64).map(route).collect();
    format!(
        "[general]\nlog_level = \"error\"\ntui = false\n[[upstream]]\ntype = \"tcp\"\nbind = \"127.0.0.1:{port}\"\n\
         [[downstream]]\nname = \"devices\"\n{downstream}{routes}"
    )
}

pub(super) fn modbus_proxy_rs(server: u16, port: u16) -> String {
    format!("devices:\n- modbus:\n    url: 127.0.0.1:{server}\n  listen:\n    bind: 127.0.0.1:{port}\n")
}
