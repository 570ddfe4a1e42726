//! Checks the certificates of clients and servers, each by authorities with their own lists of revoked certificates.

use std::sync::Arc;

use mobgate::settings::Certificate;
use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::{CryptoProvider, verify_tls12_signature, verify_tls13_signature};
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::server::WebPkiClientVerifier;
use rustls::server::danger::{ClientCertVerified, ClientCertVerifier};
use rustls::{
    CertificateError, DigitallySignedStruct, DistinguishedName, Error, RootCertStore, SignatureScheme,
};

use super::files::{self, Fault};

type Signed = Result<HandshakeSignatureValid, Error>;

/// The methods that both traits of rustls have: signatures are checked as the provider does.
macro_rules! checks_signatures {
    () => {
        fn verify_tls12_signature(
            &self,
            message: &[u8],
            certificate: &CertificateDer<'_>,
            signed: &DigitallySignedStruct,
        ) -> Signed {
            let algorithms = &self.provider.signature_verification_algorithms;
            verify_tls12_signature(message, certificate, signed, algorithms)
        }

        fn verify_tls13_signature(
            &self,
            message: &[u8],
            certificate: &CertificateDer<'_>,
            signed: &DigitallySignedStruct,
        ) -> Signed {
            let algorithms = &self.provider.signature_verification_algorithms;
            verify_tls13_signature(message, certificate, signed, algorithms)
        }

        fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
            self.provider.signature_verification_algorithms.supported_schemes()
        }
    };
}

fn roots(certificates: Vec<CertificateDer<'static>>) -> Arc<RootCertStore> {
    let mut roots = RootCertStore::empty();
    roots.add_parsable_certificates(certificates);
    Arc::new(roots)
}

/// The first verifier that knows the issuer decides.
fn first_to_know<V, T>(verifiers: &[V], verify: impl Fn(&V) -> Result<T, Error>) -> Result<T, Error> {
    let mut all = verifiers.iter().map(verify);
    let unknown = Error::InvalidCertificate(CertificateError::UnknownIssuer);
    all.find(|verified| !matches!(verified, Err(error) if *error == unknown)).unwrap_or(Err(unknown))
}

/// Checks clients by one line of authorities.
pub(super) fn clients(
    authority: &Certificate,
    provider: &Arc<CryptoProvider>,
) -> Result<Arc<dyn ClientCertVerifier>, Fault> {
    let roots = roots(files::certificates(authority)?);
    let verifier = WebPkiClientVerifier::builder_with_provider(roots, provider.clone());
    Ok(verifier.with_crls(files::revoked(authority)?).build()?)
}

/// Checks clients, who must show certificates.
#[derive(Debug)]
pub(super) struct Clients {
    authorities: Vec<Arc<dyn ClientCertVerifier>>,
    subjects: Vec<DistinguishedName>,
    provider: Arc<CryptoProvider>,
}

impl Clients {
    pub(super) fn new(authorities: Vec<Arc<dyn ClientCertVerifier>>, provider: Arc<CryptoProvider>) -> Self {
        let subjects = authorities.iter().flat_map(|one| one.root_hint_subjects()).cloned().collect();
        Self { authorities, subjects, provider }
    }
}

impl ClientCertVerifier for Clients {
    fn root_hint_subjects(&self) -> &[DistinguishedName] {
        &self.subjects
    }

    fn verify_client_cert(
        &self,
        certificate: &CertificateDer<'_>,
        between: &[CertificateDer<'_>],
        now: UnixTime,
    ) -> Result<ClientCertVerified, Error> {
        first_to_know(&self.authorities, |authority| authority.verify_client_cert(certificate, between, now))
    }

    checks_signatures!();
}

/// Checks servers by one line of the settings.
#[derive(Debug)]
pub(super) struct ServerAuthority {
    /// Checks the chain to an authority and the server's name. `None` if no certificate of the line is an authority.
    by_authority: Option<Arc<WebPkiServerVerifier>>,
    /// Pinned certificates of servers.
    known: Vec<CertificateDer<'static>>,
}

/// Checks servers by one line: its certificates are authorities, and with `may_be_own` also pinned certificates.
pub(super) fn servers(
    authority: &Certificate,
    may_be_own: bool,
    provider: &Arc<CryptoProvider>,
) -> Result<ServerAuthority, Fault> {
    let certificates = files::certificates(authority)?;
    let known = if may_be_own { certificates.clone() } else { Vec::new() };
    let roots = roots(certificates);
    if roots.is_empty() {
        return Ok(ServerAuthority { by_authority: None, known });
    }
    let verifier = WebPkiServerVerifier::builder_with_provider(roots, provider.clone());
    let by_authority = Some(verifier.with_crls(files::revoked(authority)?).build()?);
    Ok(ServerAuthority { by_authority, known })
}

/// Checks servers.
#[derive(Debug)]
pub(super) struct Servers {
    authorities: Vec<ServerAuthority>,
    provider: Arc<CryptoProvider>,
}

impl Servers {
    pub(super) fn new(authorities: Vec<ServerAuthority>, provider: Arc<CryptoProvider>) -> Self {
        Self { authorities, provider }
    }
}

impl ServerCertVerifier for Servers {
    /// A pinned certificate is trusted as it is, whatever its name and dates.
    fn verify_server_cert(
        &self,
        certificate: &CertificateDer<'_>,
        between: &[CertificateDer<'_>],
        name: &ServerName<'_>,
        ocsp: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        if self.authorities.iter().any(|authority| authority.known.iter().any(|known| known == certificate)) {
            return Ok(ServerCertVerified::assertion());
        }
        first_to_know(&self.authorities, |ServerAuthority { by_authority, .. }| match by_authority {
            Some(authority) => authority.verify_server_cert(certificate, between, name, ocsp, now),
            None => Err(Error::InvalidCertificate(CertificateError::UnknownIssuer)),
        })
    }

    checks_signatures!();
}
