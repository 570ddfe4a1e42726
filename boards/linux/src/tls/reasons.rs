//! Why a handshake failed, in words.

use rustls::{AlertDescription, CertificateError, Error};

/// What the peer did wrong, or says that the gateway did.
pub(crate) fn reason(error: &Error) -> &'static str {
    match error {
        Error::NoCertificatesPresented => "it shows no certificate",
        Error::InvalidCertificate(fault) => of_certificate(fault),
        Error::PeerIncompatible(_) => "it knows neither TLS 1.2 nor 1.3 as the gateway does",
        Error::InvalidMessage(_) | Error::InappropriateMessage { .. } => "it does not speak TLS",
        Error::AlertReceived(alert) => of_alert(*alert),
        _ => "TLS cannot be agreed on",
    }
}

fn of_certificate(fault: &CertificateError) -> &'static str {
    match fault {
        CertificateError::Expired | CertificateError::ExpiredContext { .. } => "its certificate has expired",
        CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
            "its certificate is not valid yet"
        }
        CertificateError::Revoked => "its certificate is revoked",
        CertificateError::UnknownRevocationStatus => "no list says whether its certificate is revoked",
        CertificateError::UnknownIssuer => "its certificate is of no trusted authority",
        CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. } => {
            "its certificate is for another address"
        }
        CertificateError::InvalidPurpose | CertificateError::InvalidPurposeContext { .. } => {
            "its certificate is for another purpose"
        }
        _ => "its certificate is not valid",
    }
}

/// Alerts about certificates (RFC 8446 6.2) are about the gateway's.
fn of_alert(alert: AlertDescription) -> &'static str {
    match alert {
        AlertDescription::NoCertificate | AlertDescription::CertificateRequired => {
            "it wants a certificate of the gateway"
        }
        AlertDescription::BadCertificate
        | AlertDescription::UnsupportedCertificate
        | AlertDescription::CertificateRevoked
        | AlertDescription::CertificateExpired
        | AlertDescription::CertificateUnknown
        | AlertDescription::UnknownCA
        | AlertDescription::AccessDenied => "it does not accept the gateway's certificate",
        AlertDescription::ProtocolVersion => "it has no version of TLS in common with the gateway",
        _ => "it refuses TLS",
    }
}
