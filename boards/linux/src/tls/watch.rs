//! The state of the certificates in the settings: for `show certificates`, and in the log before one expires.

use std::collections::HashMap;
use std::fmt;
use std::time::{Duration, SystemTime};

use embassy_time::{Instant, Timer};
use jiff::Timestamp;
use mobgate::gateway::Gateway;
use mobgate::settings::{Certificate, Purpose};
use rustls::pki_types::CertificateDer;

use super::facts::{Facts, facts, next_update};
use super::files::{self, Fault};
use crate::calendar;

/// How long before it expires a certificate is reported.
const AHEAD: Duration = Duration::from_secs(30 * DAY_SECS);
const DAY_SECS: u64 = 86_400;
/// How often the files are looked at.
const LOOK: embassy_time::Duration = embassy_time::Duration::from_secs(3_600);
/// How often the same problem is reported.
const TELL: embassy_time::Duration = embassy_time::Duration::from_secs(DAY_SECS);

/// What is wrong with a certificate, or will be soon; empty if nothing is.
pub fn state(certificate: &Certificate) -> String {
    match look(certificate, calendar::now()) {
        Ok((_, state)) => state,
        Err(fault) => fault.to_string(),
    }
}

/// The certificate of the line that expires first, and a problem of any of them.
fn look(certificate: &Certificate, now: SystemTime) -> Result<(Facts, String), Fault> {
    let file = || certificate.file.to_string();
    let chain = match certificate.purpose {
        Purpose::Own => files::own(certificate)?.0,
        Purpose::Clients | Purpose::Servers => files::certificates(certificate)?,
    };
    let read = |one: &CertificateDer<'_>| facts(one).ok_or(Fault::File(file(), "it is corrupt"));
    let all = chain.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    let first = all.into_iter().min_by_key(|facts| facts.not_after).ok_or(Fault::Absent)?;
    let lists = match certificate.purpose {
        Purpose::Own => Vec::new(),
        Purpose::Clients | Purpose::Servers => files::revoked(certificate)?,
    };
    let is_old = |list| next_update(list).is_some_and(|next| next < now);
    let mut state = validity(&first, now);
    if lists.iter().any(is_old) {
        let list = "the list of revoked certificates is older than its authority allows";
        state = if state.is_empty() { list.to_owned() } else { format!("{state}; {list}") };
    }
    Ok((first, state))
}

fn validity(facts: &Facts, now: SystemTime) -> String {
    if now < facts.not_before {
        return "not valid yet".to_owned();
    }
    match facts.not_after.duration_since(now) {
        Err(_) => "expired".to_owned(),
        Ok(left) if left < AHEAD => format!("expires in {} days", left.as_secs() / DAY_SECS),
        Ok(_) => String::new(),
    }
}

/// Writes the expiry date, subject, issuer and state of `certificate`, separated by tabs.
pub fn write(certificate: &Certificate, out: &mut dyn fmt::Write) -> fmt::Result {
    match look(certificate, calendar::now()) {
        Ok((Facts { subject, issuer, not_after, .. }, state)) => {
            let end = Timestamp::try_from(not_after).unwrap_or(Timestamp::MAX);
            let date = end.to_string();
            let date = date.split('T').next().unwrap_or_default();
            let state = if state.is_empty() { "good" } else { &state };
            write!(out, "{date}\t{}\t{}\t{state}", visible(&subject), visible(&issuer))
        }
        Err(fault) => write!(out, "-\t-\t-\t{fault}"),
    }
}

/// What others have written, as one line of a table.
fn visible(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { '?' } else { letter }).collect()
}

/// Says in the log what is wrong with certificates, once a day each.
pub async fn run(gateway: &Gateway<'_>) {
    let mut told = HashMap::<String, (String, Instant)>::new();
    loop {
        let now = Instant::now();
        let certificates = gateway.settings(|settings| settings.certificates().to_vec());
        told.retain(|name, _| certificates.iter().any(|one| one.name == name.as_str()));
        for certificate in &certificates {
            let (name, state) = (certificate.name.to_string(), state(certificate));
            let again = told.get(&name).is_some_and(|(before, at)| *before == state && now < *at + TELL);
            if !state.is_empty() && !again {
                log::warn!("certificate {name}: {state}");
            }
            if !again {
                told.insert(name, (state, now));
            }
        }
        Timer::after(LOOK).await;
    }
}
