//! `show network`: the board's own address.

use core::fmt;

use super::output::Written;
use super::rows::text;
use crate::hal::NetworkState;
use crate::settings::Settings;

const NETWORK: &str = "LINK\tADDRESS\tGATEWAY\tETHERNET\tSETTING";

/// The row at `place`.
pub(super) fn network(
    settings: &Settings,
    state: Option<NetworkState>,
    place: usize,
    out: &mut dyn fmt::Write,
) -> Written {
    let Some(NetworkState { link, address, hardware }) = state else {
        return (place == 0).then(|| out.write_str("the operating system has the network"));
    };
    match place {
        0 => return Some(out.write_str(NETWORK)),
        1 => {}
        _ => return None,
    }
    let link = if link { "up" } else { "down" };
    let shown = address.map_or(text(format_args!("-")), |own| text(format_args!("{own}")));
    let gateway = address.and_then(|own| own.gateway);
    let gateway = gateway.map_or(text(format_args!("-")), |gateway| text(format_args!("{gateway}")));
    let [a, b, c, d, e, f] = hardware;
    let hardware = text(format_args!("{a:02x}:{b:02x}:{c:02x}:{d:02x}:{e:02x}:{f:02x}"));
    Some(write!(out, "{link}\t{shown}\t{gateway}\t{hardware}\t{}", settings.own_network()))
}
