//! Modbus/TCP Security and HTTPS: TLS 1.2 and 1.3 with the certificates of the settings.
//!
//! Nothing is cached between connections: the files are read for each, so a renewed certificate or revocation list takes effect with
//! the next one. For the same reason sessions are not resumed: a resumed one would skip the check of the certificate.

use std::net::IpAddr;
use std::sync::{Arc, OnceLock};

use mobgate::gateway::Gateway;
use mobgate::hal::{OpenError, OpenErrorKind};
use mobgate::settings::{ClientRole, Host, PortId, PortKind, Purpose, ServerAddress, Settings, TlsSettings};
use rustls::client::Resumption;
use rustls::pki_types::ServerName;
use rustls::server::NoServerSessionStorage;
use rustls::{ClientConfig, ClientConnection, Connection, ServerConfig, ServerConnection};

mod facts;
mod files;
mod provider;
mod reasons;
mod session;
mod verify;
mod watch;

pub(crate) use self::session::Session;
pub use self::watch::{run as watch, state, write};

use self::files::Fault;
use self::provider::provider;
use self::reasons::reason;
use self::verify::{Clients, Servers};
use crate::descriptor::Descriptor;

/// Versions, the better first (Modbus/TCP Security: 1.2 or later).
const VERSIONS: &[&rustls::SupportedProtocolVersion] = &[&rustls::version::TLS13, &rustls::version::TLS12];

/// What is wrong with a certificate of the settings; the console has the details.
const UNUSABLE: OpenError =
    OpenError::new(OpenErrorKind::Failed, "a certificate cannot be used: show certificates");

static GATEWAY: OnceLock<&'static Gateway<'static>> = OnceLock::new();

/// Lets ports of `gateway` speak TLS.
pub fn start(gateway: &'static Gateway<'static>) {
    GATEWAY.get_or_init(|| gateway);
}

/// Fails if clients of the port could not be served.
pub(crate) fn prepare(port: PortId) -> Result<(), OpenError> {
    of_port(port, server).map(drop)
}

/// Begins TLS on `io` as a client of `peer`, or else as a server, and gives the role of a client.
pub(crate) async fn begin(
    io: &mut Descriptor<std::net::TcpStream>,
    port: PortId,
    peer: Option<&ServerAddress>,
) -> Result<(Session, ClientRole), OpenError> {
    let connection = match peer {
        Some(peer) => {
            let name = server_name(peer)?;
            let config = of(port, client)?;
            ClientConnection::new(Arc::new(config), name).map(Connection::Client)
        }
        None => ServerConnection::new(of_port(port, server)?).map(Connection::Server),
    };
    let connection = connection.map_err(|error| refusal(&error))?;
    let session = Session::begin(io, connection).await.map_err(|error| refusal_of_io(&error))?;
    let role = session.peer_certificate().map_or(ClientRole::NONE, facts::role);
    Ok((session, role))
}

fn refusal(error: &rustls::Error) -> OpenError {
    OpenError::new(OpenErrorKind::Failed, reason(error))
}

fn refusal_of_io(error: &std::io::Error) -> OpenError {
    let tls = error.get_ref().and_then(|inner| inner.downcast_ref::<rustls::Error>());
    tls.map_or(OpenError::new(OpenErrorKind::Failed, "it has left before it showed a certificate"), refusal)
}

/// The name that the certificate of `server` must have.
fn server_name(server: &ServerAddress) -> Result<ServerName<'static>, OpenError> {
    match &server.host {
        Host::Address(address) => Ok(ServerName::IpAddress(IpAddr::into(*address))),
        Host::Name(name) => ServerName::try_from(name.as_str().to_owned())
            .map_err(|_| OpenError::new(OpenErrorKind::Failed, "no certificate can have such a name")),
    }
}

/// Makes what the port needs of its settings.
fn of_port<T>(
    port: PortId,
    make: impl FnOnce(&Settings, &PortKind, &TlsSettings) -> Result<T, Fault>,
) -> Result<T, OpenError> {
    of(port, |settings, tls| {
        let kind = settings.port(port).map(|port| &port.kind).ok_or(Fault::Absent)?;
        make(settings, kind, tls)
    })
}

/// Makes what the port, or the publisher, needs of its settings; says in the log what is wrong with a certificate.
fn of<T>(id: PortId, make: impl FnOnce(&Settings, &TlsSettings) -> Result<T, Fault>) -> Result<T, OpenError> {
    let gateway = GATEWAY.get().ok_or(UNUSABLE)?;
    gateway.settings(|settings| {
        make(settings, settings.tls(id).ok_or(UNUSABLE)?).map_err(|fault| {
            log::debug!("port {}: {fault}", settings.name(id));
            UNUSABLE
        })
    })
}

fn server(settings: &Settings, kind: &PortKind, tls: &TlsSettings) -> Result<Arc<ServerConfig>, Fault> {
    let own =
        settings.certificates_for(Purpose::Own, tls.certificate.as_deref()).next().ok_or(Fault::Absent)?;
    let (chain, key) = files::own(own)?;
    let config = ServerConfig::builder_with_provider(provider()).with_protocol_versions(VERSIONS)?;
    let config = if kind.wants_certificates() {
        let trusted = settings.certificates_for(Purpose::Clients, tls.trust.as_deref());
        let clients =
            trusted.map(|authority| verify::clients(authority, &provider())).collect::<Result<_, _>>()?;
        config.with_client_cert_verifier(Arc::new(Clients::new(clients, provider())))
    } else {
        config.with_no_client_auth()
    };
    let mut config = config.with_single_cert(chain, key)?;
    config.session_storage = Arc::new(NoServerSessionStorage {});
    config.send_tls13_tickets = 0;
    Ok(Arc::new(config))
}

fn client(settings: &Settings, tls: &TlsSettings) -> Result<ClientConfig, Fault> {
    let trusted = settings.certificates_for(Purpose::Servers, tls.trust.as_deref());
    // A pinned certificate counts only for the port that names it: the key of one device must not authenticate another.
    let may_be_own = tls.trust.is_some();
    let servers = trusted
        .map(|authority| verify::servers(authority, may_be_own, &provider()))
        .collect::<Result<_, _>>()?;
    let config = ClientConfig::builder_with_provider(provider()).with_protocol_versions(VERSIONS)?;
    let verifier = Arc::new(Servers::new(servers, provider()));
    let config = config.dangerous().with_custom_certificate_verifier(verifier);
    let mut config = match &tls.certificate {
        None => config.with_no_client_auth(),
        Some(name) => {
            let own = settings.certificates_for(Purpose::Own, Some(name)).next().ok_or(Fault::Absent)?;
            let (chain, key) = files::own(own)?;
            config.with_client_auth_cert(chain, key)?
        }
    };
    config.resumption = Resumption::disabled();
    Ok(config)
}
