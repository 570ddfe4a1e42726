//! The files of certificates, private keys and lists of revoked certificates, in PEM.

use std::fmt;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use mobgate::settings::Certificate;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, CertificateRevocationListDer, PrivateKeyDer};
use rustls::server::VerifierBuilderError;

use super::provider::provider;
use crate::file;

/// Others must have no access to a private key.
const WORLD: u32 = 0o007;

/// Why a certificate of the settings cannot be used. Never contains key material.
#[derive(Debug)]
pub(crate) enum Fault {
    /// There is none.
    Absent,
    /// A file cannot be used, for this reason.
    File(String, &'static str),
    /// The private key is that of another certificate.
    OtherKey(String),
    /// TLS refuses it.
    Tls(rustls::Error),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Absent => f.write_str("there is no such certificate"),
            Self::File(file, reason) => write!(f, "{file}: {reason}"),
            Self::OtherKey(file) => write!(f, "{file}: the private key is not that of the certificate"),
            Self::Tls(error) => write!(f, "{error}"),
        }
    }
}

impl From<rustls::Error> for Fault {
    fn from(error: rustls::Error) -> Self {
        Self::Tls(error)
    }
}

impl From<VerifierBuilderError> for Fault {
    fn from(error: VerifierBuilderError) -> Self {
        Self::Tls(rustls::Error::General(error.to_string()))
    }
}

type Chain = Vec<CertificateDer<'static>>;

fn read(path: &str) -> Result<Vec<u8>, Fault> {
    let fault = |reason| Fault::File(path.to_owned(), reason);
    file::read(Path::new(path)).map_err(fault)?.ok_or_else(|| fault("no such file"))
}

/// All objects of a kind in the file at `path`, of which there is at least one.
fn objects<T: PemObject>(path: &str, none: &'static str) -> Result<Vec<T>, Fault> {
    let fault = |reason| Fault::File(path.to_owned(), reason);
    let found: Result<Vec<T>, _> = T::pem_slice_iter(&read(path)?).collect();
    let found = found.map_err(|_| fault("it is not PEM, or corrupt"))?;
    if found.is_empty() { Err(fault(none)) } else { Ok(found) }
}

/// The certificates of a line of the settings.
pub(crate) fn certificates(of: &Certificate) -> Result<Chain, Fault> {
    objects(&of.file, "there is no certificate in it (PEM)")
}

/// The lists of revoked certificates of authorities, if they have any.
pub(crate) fn revoked(of: &Certificate) -> Result<Vec<CertificateRevocationListDer<'static>>, Fault> {
    let none = "there is no list of revoked certificates in it (PEM, X509 CRL)";
    of.second.as_ref().map_or(Ok(Vec::new()), |file| objects(file, none))
}

/// The gateway's own certificate, with its private key.
pub(crate) fn own(of: &Certificate) -> Result<(Chain, PrivateKeyDer<'static>), Fault> {
    let chain = certificates(of)?;
    let path = of.second.as_deref().ok_or(Fault::Absent)?;
    let fault = |reason| Fault::File(path.to_owned(), reason);
    if fs::metadata(path).is_ok_and(|facts| facts.mode() & WORLD != 0) {
        return Err(fault("everybody may read it: chmod o= it"));
    }
    let key = PrivateKeyDer::from_pem_slice(&read(path)?)
        .map_err(|_| fault("there is no private key in it (PEM, not encrypted)"))?;
    let signing = provider().key_provider.load_private_key(key.clone_key());
    let signing = signing.map_err(|_| fault("its private key is of no kind that is known"))?;
    match rustls::sign::CertifiedKey::new(chain.clone(), signing).keys_match() {
        Err(rustls::Error::InconsistentKeys(rustls::InconsistentKeys::KeyMismatch)) => {
            Err(Fault::OtherKey(path.to_owned()))
        }
        Err(error @ rustls::Error::InvalidCertificate(_)) => Err(error.into()),
        _ => Ok((chain, key)),
    }
}
