//! Modbus/TCP Security: certificates, the ports that use them, and the roles that clients' certificates have.

use heapless::{String, Vec};

use crate::settings::Name;

/// Whether there is TLS: the board implements it, the core only starts it.
pub(crate) const TLS: bool = cfg!(feature = "tls");

/// Certificates in the settings.
pub(crate) const CERTIFICATES_MAX: usize = if TLS { 16 } else { 0 };

/// Longest role in bytes.
pub(crate) const CLIENT_ROLE_BYTES_MAX: usize = if TLS { 31 } else { 0 };

/// Longest path of a file in bytes.
const FILE_BYTES_MAX: usize = 127;

/// The path of a file.
pub type FileName = String<FILE_BYTES_MAX>;

pub(crate) type Certificates = Vec<Certificate, CERTIFICATES_MAX>;

/// A file of certificates (PEM), and what they are for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Certificate {
    /// Its name in the settings.
    pub name: Name,
    /// Its purpose.
    pub purpose: Purpose,
    /// The file with the certificates.
    pub file: FileName,
    /// The private key's file for the gateway's own certificate; the file of revocation lists for authorities, if any.
    pub second: Option<FileName>,
}

/// What certificates are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// The gateway's own certificate, with its intermediate authorities.
    Own,
    /// Authorities that certify clients of the gateway.
    Clients,
    /// Authorities that certify servers, or the certificate of a server itself.
    Servers,
}

/// The certificates of a port with TLS.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TlsSettings {
    /// Whether the port speaks TLS.
    pub on: bool,
    /// The gateway's own certificate. `None`: a server shows the first one of the settings, a client none.
    pub certificate: Option<Name>,
    /// The only authorities, or the only server, that the port trusts. `None`: all authorities for its side.
    pub trust: Option<Name>,
}

// Ports without TLS have none.
#[cfg(feature = "tls")]
impl TlsSettings {
    /// No TLS.
    pub(crate) const OFF: Self = Self { on: false, certificate: None, trust: None };
}

/// The role of a client, which rules can require: up to 31 bytes of text, padded with zeros. A client without TLS, or whose certificate
/// names no role, has none: the NULL role of the specification.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClientRole([u8; CLIENT_ROLE_BYTES_MAX]);

impl ClientRole {
    /// None.
    pub const NONE: Self = Self([0; CLIENT_ROLE_BYTES_MAX]);

    /// The role called `name`: visible characters other than `,` and `"`, not beginning with `#`. `None` for any other text.
    pub fn new(name: &str) -> Option<Self> {
        let is_plain = |byte: u8| byte.is_ascii_graphic() && byte != b',' && byte != b'"';
        let good = !name.is_empty() && !name.starts_with('#') && name.bytes().all(is_plain);
        let mut role = Self::NONE;
        role.0.get_mut(..name.len()).filter(|_| good)?.copy_from_slice(name.as_bytes());
        Some(role)
    }

    /// Whether there is no role.
    pub fn is_none(&self) -> bool {
        self.0.first().is_none_or(|first| *first == 0)
    }

    /// Its name; empty for none.
    pub fn name(&self) -> &str {
        let end = self.0.iter().position(|byte| *byte == 0).unwrap_or(self.0.len());
        self.0.get(..end).and_then(|name| core::str::from_utf8(name).ok()).unwrap_or_default()
    }
}
