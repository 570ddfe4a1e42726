//! The certificates: `certificate gateway own /etc/mobgate/tls/gateway.pem key /etc/mobgate/tls/gateway.key`,
//! `certificate plant clients /etc/mobgate/tls/plant.pem revoked /etc/mobgate/tls/plant.crl`.

use core::fmt::{self, Display};

use super::changed::Changed;
use super::listed::{keywords, listed};
use super::problem::Problem;
use super::values::named;
use super::words::{Word, Words, Wrong};
use crate::settings::{
    CERTIFICATES_MAX, Certificate, Certificates, FileName, Name, PortKind, Purpose, Settings, Side,
    TlsSettings,
};
// As what uses it.
#[cfg(feature = "mqtt")]
use crate::settings::Publisher;

keywords!(PURPOSES: Purpose { "own": Own, "clients": Clients, "servers": Servers });
const PURPOSES_EXPECTED: &str = listed!(PURPOSES);

/// The words before the second file of a line.
const KEY: &[(&str, ())] = &[("key", ())];
const REVOKED: &[(&str, ())] = &[("revoked", ())];

/// The keywords of the line.
pub(crate) fn keywords() -> impl Iterator<Item = &'static str> {
    PURPOSES.iter().map(|(word, _)| *word).chain(["key", "revoked"])
}

/// Parses a certificate's name.
pub(crate) fn certificate_name(word: Word) -> Result<Name, Wrong> {
    named(word, "a certificate's name: a letter, then letters, digits, - _ or ., at most 15")
}

/// Parses a certificate up to the end of the line, and stores it instead of the one of that name.
pub(crate) fn certificate(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    let word = words.take();
    let name = certificate_name(word)?;
    let purpose = words.take().keyword(PURPOSES, PURPOSES_EXPECTED)?;
    let file = file(words.take())?;
    let second = if purpose == Purpose::Own {
        words.take().keyword(KEY, "key and the file with the private key")?;
        Some(self::file(words.take())?)
    } else if words.peek().is_end() {
        None
    } else {
        words.take().keyword(REVOKED, "revoked and the file with the list, or the end of the line")?;
        Some(self::file(words.take())?)
    };
    words.end()?;
    let certificate = Certificate { name, purpose, file, second };
    let old = settings.certificates.clone();
    match settings.certificates.iter_mut().find(|other| other.name.eq_ignore_ascii_case(&certificate.name)) {
        Some(other) => *other = certificate,
        None => {
            let full = settings.certificates.push(certificate);
            full.map_err(|_| word.error(Problem::CertificatesFull(CERTIFICATES_MAX)))?;
        }
    }
    keep_ports_whole(settings, old, word)
}

/// A path from the root, so that it means the same file wherever the gateway is started.
fn file(word: Word) -> Result<FileName, Wrong> {
    let good = word.text.starts_with('/') && word.text.bytes().all(|byte| byte.is_ascii_graphic());
    let file = if good { FileName::try_from(word.text).ok() } else { None };
    file.ok_or_else(|| word.expected("a file such as /etc/mobgate/tls/plant.pem, at most 127 characters"))
}

/// Deletes a certificate that no port needs.
pub(crate) fn delete_certificate(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    let word = words.take();
    words.end()?;
    let at = settings.certificates.iter().position(|other| other.name.eq_ignore_ascii_case(word.text));
    let at = at.ok_or_else(|| word.error(Problem::NoSuchCertificate))?;
    let old = settings.certificates.clone();
    settings.certificates.remove(at);
    keep_ports_whole(settings, old, word)
}

/// Takes the `old` certificates back if a port lacks one of them now.
fn keep_ports_whole(settings: &mut Settings, old: Certificates, word: Word) -> Result<Changed, Wrong> {
    let lacks = |kind: &PortKind| lacks_certificate(settings, kind).is_some();
    let port = settings.ports.iter().flatten().find(|port| lacks(&port.kind)).map(|port| port.name.clone());
    match port {
        Some(port) => {
            settings.certificates = old;
            Err(word.error(Problem::CertificateInUse(port)))
        }
        None => {
            #[cfg(feature = "mqtt")]
            if let Some(publisher) =
                settings.publishers.iter().find(|other| lacks_of_publisher(settings, other).is_some())
            {
                let problem = Problem::CertificatePublishes(publisher.name.clone());
                settings.certificates = old;
                return Err(word.error(problem));
            }
            Ok(Changed::Other)
        }
    }
}

/// What a publisher lacks of the certificates in `settings`.
// As what uses it.
#[cfg(feature = "mqtt")]
pub(crate) fn lacks_of_publisher(settings: &Settings, publisher: &Publisher) -> Option<Problem> {
    let TlsSettings { certificate, trust, .. } = Some(&publisher.tls).filter(|tls| tls.on)?;
    let own = certificate.as_ref().and_then(|_| lacks(settings, certificate, Purpose::Own, OWN));
    own.or_else(|| lacks(settings, trust, Purpose::Servers, SERVERS))
}

/// The rests of lines that are missing.
const OWN: &str = "own FILE key FILE";
const SERVERS: &str = "servers FILE";

/// The problem that no certificate for `purpose`, with this name if there is one, is in `settings`.
fn lacks(settings: &Settings, name: &Option<Name>, purpose: Purpose, line: &'static str) -> Option<Problem> {
    let fits = |other: &Certificate| {
        other.purpose == purpose && name.as_ref().is_none_or(|name| other.name.eq_ignore_ascii_case(name))
    };
    let name = || name.clone().unwrap_or_else(|| Name::try_from("NAME").unwrap_or_default());
    (!settings.certificates.iter().any(fits)).then(|| Problem::NoCertificate { name: name(), line })
}

/// What a port of this kind lacks of the certificates in `settings`.
pub(crate) fn lacks_certificate(settings: &Settings, kind: &PortKind) -> Option<Problem> {
    let TlsSettings { certificate, trust, .. } = kind.tls()?;
    let lacks = |name, purpose, line| lacks(settings, name, purpose, line);
    let is_server = kind.side() == Side::Server;
    let own = || lacks(certificate, Purpose::Own, OWN);
    let own = if is_server || certificate.is_some() { own() } else { None };
    let trusted = || match is_server {
        true if !kind.wants_certificates() => None,
        true => lacks(trust, Purpose::Clients, "clients FILE"),
        false => lacks(trust, Purpose::Servers, SERVERS),
    };
    own.or_else(trusted)
}

/// The words after `certificate`.
impl Display for Certificate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, purpose, file, second } = self;
        write!(f, "{name} {purpose} {file}")?;
        let word = if *purpose == Purpose::Own { "key" } else { "revoked" };
        second.as_ref().map_or(Ok(()), |second| write!(f, " {word} {second}"))
    }
}
