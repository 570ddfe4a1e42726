//! The NTP server: `ntp 192.168.1.1`, `ntp off`.

use super::{
    changed::Changed,
    port_values::server_address,
    words::{Words, Wrong},
};
use crate::settings::Settings;

/// The port of NTP (RFC 5905, 7.2).
const NTP_PORT: u16 = 123;

/// `ntp ...`
pub(crate) fn ntp(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    let word = words.take();
    let server = if word.is("off") { None } else { Some(server_address(word, NTP_PORT)?) };
    words.end()?;
    settings.ntp.clear();
    settings.ntp.extend(server);
    Ok(Changed::Other)
}
