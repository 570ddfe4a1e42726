//! The settings of the web interface's port.

use super::address::Allowed;
use super::network::TcpListen;
// Left out of images without TLS; also below.
#[cfg(feature = "tls")]
use super::tls::TlsSettings;

/// The listener of the web interface.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HttpSettings {
    /// Where it listens.
    pub(crate) listen: TcpListen,
    /// Peers that may connect; others are disconnected at once.
    pub(crate) allowed: Allowed,
    /// Whether users may log in from other machines without encryption.
    pub(crate) cleartext: bool,
    /// Whether metrics need neither log-in nor encryption.
    pub(crate) metrics: bool,
    /// HTTPS: the gateway shows its certificate. Clients need one only if `trust` names their authorities.
    #[cfg(feature = "tls")]
    pub(crate) tls: TlsSettings,
}

impl HttpSettings {
    /// A listener on `listen` for everybody, without encryption.
    pub(crate) const fn new(listen: TcpListen) -> Self {
        Self {
            listen,
            allowed: Allowed::everybody(),
            cleartext: false,
            metrics: false,
            #[cfg(feature = "tls")]
            tls: TlsSettings::OFF,
        }
    }

    /// Whether traffic is encrypted.
    pub(crate) const fn is_encrypted(&self) -> bool {
        #[cfg(feature = "tls")]
        return self.tls.on;
        #[cfg(not(feature = "tls"))]
        false
    }
}
