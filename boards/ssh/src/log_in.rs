//! Log-in (RFC 4252): with a key or a password, as the gateway decides.

use core::net::IpAddr;
use core::ops::Range;

use base64ct::{Base64, Encoding};
use embassy_time::{Duration, Timer};
use embedded_io_async::{Read, Write};
use heapless::{String, Vec};
use mobgate::gateway::{Credential, Gateway};
use mobgate::hal::System;
use mobgate::settings::NAME_BYTES_MAX;
use salty::{PublicKey, Signature};

use crate::Error;
use crate::link::Link;
use crate::wire::{ED25519, Reader, Writer};

const SERVICE_REQUEST: u8 = 5;
const SERVICE_ACCEPT: u8 = 6;
const REQUEST: u8 = 50;
const FAILURE: u8 = 51;
const SUCCESS: u8 = 52;
const KEY_ACCEPTED: u8 = 60;

/// Failed requests after which a connection ends.
const REQUESTS_MAX: usize = 12;
/// A refusal takes this long, whatever the reason.
const REFUSAL: Duration = Duration::from_millis(300);

/// A public key as clients send it: the type's name and 32 bytes (RFC 8709, 4).
const BLOB_BYTES: usize = 51;
/// The same as the settings have it.
const BLOB_TEXT_BYTES: usize = 68;
/// What a client signs: the session's number, and the request without the signature (RFC 4252, 7). A longer name is nobody's.
const SIGNED_BYTES_MAX: usize =
    4 + 32 + 1 + 4 + NAME_BYTES_MAX + 4 + 14 + 4 + 9 + 1 + 4 + 11 + 4 + BLOB_BYTES;

/// The name of a user of the settings.
pub(crate) type UserName = String<NAME_BYTES_MAX>;

/// Credentials. `Other` always fails and is not counted: clients use it to ask for the methods.
enum Method<'m> {
    Key { key: Key<'m>, proof: Option<Proof<'m>> },
    Password(&'m str),
    Other,
}

#[derive(Clone, Copy)]
struct Key<'m> {
    blob: &'m [u8; BLOB_BYTES],
    bytes: &'m [u8; 32],
}

/// A signature, and what of the payload it signs.
struct Proof<'m> {
    signature: &'m [u8; 64],
    signed: &'m [u8],
}

/// A request to log in.
struct Request<'m> {
    user: &'m str,
    method: Method<'m>,
}

/// The decision about a request.
enum Decision {
    Success(UserName),
    /// The key is known; the client may prove that it has it.
    Accepted([u8; BLOB_BYTES]),
    Failure,
    /// A failure without a delay.
    Question,
}

/// Decides about log-ins.
pub(crate) struct Judge<'j, 'g, Y> {
    pub(crate) gateway: &'j Gateway<'g>,
    pub(crate) system: &'j Y,
    pub(crate) peer: IpAddr,
    /// See [`Board::passwords`](crate::Board::passwords).
    pub(crate) passwords: bool,
}

impl<'m> Request<'m> {
    fn of(payload: &'m [u8]) -> Result<Self, Error> {
        let mut fields = Reader::new(payload);
        fields.byte()?;
        let (user, service, method) = (fields.text()?, fields.text()?, fields.text()?);
        if service != "ssh-connection" {
            return Err(Error::NO_SUCH_SERVICE);
        }
        let method = match method {
            "publickey" => Self::key(payload, fields)?,
            // A new password is not set here.
            "password" if !fields.flag()? => Method::Password(fields.text()?),
            _ => Method::Other,
        };
        Ok(Self { user, method })
    }

    fn key(payload: &'m [u8], mut fields: Reader<'m>) -> Result<Method<'m>, Error> {
        let (is_proved, kind) = (fields.flag()?, fields.string()?);
        let blob = fields.string()?;
        let Ok(blob) = <&[u8; BLOB_BYTES]>::try_from(blob) else { return Ok(Method::Other) };
        let mut parts = Reader::new(blob);
        if kind != ED25519.as_bytes() || parts.string()? != kind {
            return Ok(Method::Other);
        }
        let key = Key { blob, bytes: parts.array()? };
        if !is_proved {
            return Ok(Method::Key { key, proof: None });
        }
        let mut signature = Reader::new(fields.string()?);
        if signature.string()? != kind {
            return Err(Error::MALFORMED);
        }
        let signature = signature.array()?;
        // Two lengths and a name are around the signature.
        let behind = 3 * size_of::<u32>() + ED25519.len() + signature.len();
        let signed = payload.len().checked_sub(behind).and_then(|length| payload.get(..length));
        Ok(Method::Key { key, proof: Some(Proof { signature, signed: signed.ok_or(Error::MALFORMED)? }) })
    }
}

impl Key<'_> {
    /// As the settings have it.
    fn text<'t>(&self, into: &'t mut [u8; BLOB_TEXT_BYTES]) -> &'t str {
        Base64::encode(self.blob, into).unwrap_or_default()
    }

    /// Whether the key's owner has signed this in the session.
    fn has_signed(&self, session: &[u8; 32], proof: &Proof<'_>) -> bool {
        let mut message = Vec::<u8, SIGNED_BYTES_MAX>::new();
        let whole = [&(session.len() as u32).to_be_bytes()[..], session, proof.signed]
            .iter()
            .all(|part| message.extend_from_slice(part).is_ok());
        let signature = Signature::from(proof.signature);
        let key = PublicKey::try_from(self.bytes);
        whole && key.is_ok_and(|key| key.verify(&message, &signature).is_ok())
    }
}

impl<Y: System> Judge<'_, '_, Y> {
    async fn decide(&self, session: &[u8; 32], request: &Request<'_>, counts: bool) -> Decision {
        let Request { user, method } = request;
        let log_in = async |by: Credential<'_>| self.gateway.log_in(self.system, self.peer, user, by).await;
        let enters = match method {
            Method::Key { key, proof } => {
                let mut text = [0; BLOB_TEXT_BYTES];
                let text = key.text(&mut text);
                // Looked up first: an unknown key costs no time for verifying a signature.
                let is_known = log_in(Credential::Offered { key: text, counts }).await;
                match proof {
                    None if is_known => return Decision::Accepted(*key.blob),
                    // A wrong signature counts like a wrong key.
                    Some(proof) if is_known => {
                        let is_proved = key.has_signed(session, proof);
                        log_in(Credential::Key(if is_proved { text } else { "" })).await
                    }
                    _ => false,
                }
            }
            Method::Password(password) if self.passwords => log_in(Credential::Password(password)).await,
            Method::Password(_) | Method::Other => return Decision::Question,
        };
        // Names of users fit.
        let name = UserName::try_from(*user).ok().filter(|_| enters);
        name.map_or(Decision::Failure, Decision::Success)
    }
}

impl<S: Read + Write> Link<'_, S> {
    /// Authenticates a client; returns the user.
    pub(crate) async fn log_in<Y: System>(&mut self, judge: &Judge<'_, '_, Y>) -> Result<UserName, Error> {
        // A client offers all the keys that it has, which counts once.
        let mut key_refused = false;
        for _ in 0..REQUESTS_MAX {
            let payload = self.next_request().await?;
            let session = self.agreed.as_ref().ok_or(Error::MALFORMED)?.session;
            let request = Request::of(self.incoming.payload(payload))?;
            let is_key = matches!(request.method, Method::Key { .. });
            match judge.decide(&session, &request, !key_refused).await {
                Decision::Success(user) => {
                    self.send(SUCCESS, |_| {}).await?;
                    return Ok(user);
                }
                Decision::Accepted(blob) => {
                    self.send(KEY_ACCEPTED, |message| _ = message.string(ED25519.as_bytes()).string(&blob))
                        .await?;
                    continue;
                }
                Decision::Failure => {
                    key_refused |= is_key;
                    Timer::after(REFUSAL).await;
                }
                Decision::Question => {}
            }
            let methods = if judge.passwords { "publickey,password" } else { "publickey" };
            let refuse = |message: &mut Writer<'_>| _ = message.string(methods.as_bytes()).flag(false);
            self.send(FAILURE, refuse).await?;
        }
        Err(Error::TOO_MANY_ATTEMPTS)
    }

    /// Waits for a request to log in. The service for it may be asked for first, and again.
    async fn next_request(&mut self) -> Result<Range<usize>, Error> {
        loop {
            let payload = self.receive().await?;
            match self.read(payload.clone())? {
                (REQUEST, _) => return Ok(payload),
                (SERVICE_REQUEST, mut fields) => {
                    if fields.string()? != b"ssh-userauth" {
                        return Err(Error::NO_SUCH_SERVICE);
                    }
                    self.send(SERVICE_ACCEPT, |message| _ = message.string(b"ssh-userauth")).await?;
                }
                // Nothing else is allowed before the log-in.
                _ => return Err(Error::MALFORMED),
            }
        }
    }
}
