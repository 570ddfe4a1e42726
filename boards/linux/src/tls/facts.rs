//! What certificates say: names, dates, and the role of a client.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use mobgate::settings::ClientRole;
use rustls::pki_types::{CertificateDer, CertificateRevocationListDer};
use x509_cert::Certificate;
use x509_cert::crl::CertificateList;
use x509_cert::der::Decode;
use x509_cert::der::asn1::Utf8StringRef;
use x509_cert::der::oid::ObjectIdentifier;

/// The role of a Modbus/TCP client (Modbus/TCP Security 8.4).
const ROLE: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.3.6.1.4.1.50316.802.1");

/// The facts of a certificate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Facts {
    pub(crate) subject: String,
    pub(crate) issuer: String,
    pub(crate) not_before: SystemTime,
    pub(crate) not_after: SystemTime,
}

/// The facts of a certificate, if it can be read.
pub(crate) fn facts(certificate: &CertificateDer<'_>) -> Option<Facts> {
    let certificate = Certificate::from_der(certificate).ok()?;
    let certificate = certificate.tbs_certificate();
    let validity = certificate.validity();
    Some(Facts {
        subject: certificate.subject().to_string(),
        issuer: certificate.issuer().to_string(),
        not_before: time(validity.not_before.to_unix_duration()),
        not_after: time(validity.not_after.to_unix_duration()),
    })
}

/// When the next revocation list is due, if the list says so.
pub(crate) fn next_update(list: &CertificateRevocationListDer<'_>) -> Option<SystemTime> {
    let list: CertificateList = CertificateList::from_der(list).ok()?;
    list.tbs_cert_list.next_update.map(|next| time(next.to_unix_duration()))
}

fn time(since_1970: Duration) -> SystemTime {
    UNIX_EPOCH + since_1970
}

/// The role in a client's certificate: the text of exactly one extension. Without that extension, with several, or with an invalid one,
/// the client has the NULL role of the specification.
pub(crate) fn role(certificate: &CertificateDer<'_>) -> ClientRole {
    let Ok(certificate) = Certificate::from_der(certificate) else { return ClientRole::NONE };
    let extensions = certificate.tbs_certificate().extensions().into_iter().flatten();
    let mut roles = extensions.filter(|extension| extension.extn_id == ROLE);
    let (Some(role), None) = (roles.next(), roles.next()) else { return ClientRole::NONE };
    let text = Utf8StringRef::from_der(role.extn_value.as_bytes());
    text.ok().and_then(|text| ClientRole::new(text.as_str())).unwrap_or(ClientRole::NONE)
}
