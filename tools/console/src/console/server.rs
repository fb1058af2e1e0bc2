//! The page and what it asks for, over HTTP.

use std::convert::Infallible;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, TrySendError};

use anyhow::Context;
use axum::body::Bytes;
use axum::extract::{Query, Request, State};
use axum::http::{HeaderName, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::sse::{Event as Told, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use nvsprior_link::Region;
use serde::Deserialize;
use tokio::sync::watch;
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt};

use super::event::{Asked, Command, Event};
use super::token::{Access, Role};
use super::topside::Published;

/// The page with all that it needs in it, so that only one address takes a token.
fn page() -> String {
    let scripts = [
        include_str!("page/draw.js"),
        include_str!("page/region.js"),
        include_str!("page/page.js"),
    ];
    include_str!("page/page.html")
        .replace("/* style */", include_str!("page/page.css"))
        .replace("/* scripts */", &scripts.join("\n"))
}

/// Nothing comes from elsewhere, and the address with its token goes nowhere else.
const PAGE_HEADERS: [(HeaderName, &str); 4] = [
    (header::CONTENT_TYPE, "text/html; charset=utf-8"),
    (header::CACHE_CONTROL, "no-cache"),
    (header::REFERRER_POLICY, "no-referrer"),
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'self'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src 'self' data:",
    ),
];

/// How much more the pilot's region counts.
const WEIGHT: u8 = 12;

/// The page's address, taken and not served yet.
pub struct Server {
    listener: TcpListener,
    at: SocketAddr,
    access: Access,
}

#[derive(Clone)]
struct Shared {
    plan: Arc<[u8]>,
    published: watch::Receiver<Published>,
    events: SyncSender<Event>,
}

impl Server {
    pub fn bind(at: SocketAddr) -> anyhow::Result<Server> {
        let taking = || format!("--listen {at}: choose another address or port");
        let listener = TcpListener::bind(at).with_context(taking)?;
        listener.set_nonblocking(true).with_context(taking)?;
        let at = listener.local_addr().with_context(taking)?;
        Ok(Server { listener, at, access: Access::at(at.ip())? })
    }

    /// Serves on a thread of its own. Returns the page's address; with tokens also that of those who only look.
    pub fn start(
        self,
        plan: Arc<[u8]>,
        published: watch::Receiver<Published>,
        events: SyncSender<Event>,
    ) -> anyhow::Result<String> {
        let page = |query: &String| format!("http://{}/{query}", self.at);
        let addresses: Vec<_> = self.access.queries().iter().map(page).collect();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let Server { listener, access, .. } = self;
        let router = router(Shared { plan, published, events }, access);
        let serve = move || {
            runtime.block_on(async {
                let listener = tokio::net::TcpListener::from_std(listener)?;
                axum::serve(listener, router).await
            })
        };
        std::thread::Builder::new().name("page".into()).spawn(serve).context("serving the page")?;
        Ok(addresses.join("\nto look only: "))
    }
}

fn router(shared: Shared, access: Access) -> Router {
    let page: Arc<str> = page().into();
    let picture = |State(shared): State<Shared>| png(shared.published.borrow().picture.clone());
    let chase = |State(shared): State<Shared>| png(shared.published.borrow().chase.clone());
    Router::new()
        .route("/", get(async move || (PAGE_HEADERS, Bytes::from_owner(Text(page.clone())))))
        .route("/state", get(state))
        .route("/events", get(events))
        .route("/picture.png", get(picture))
        .route("/chase.png", get(chase))
        .route("/plan.png", get(|State(shared): State<Shared>| png(shared.plan)))
        .route("/region", post(region))
        .route("/record", post(record))
        .route("/snapshot", post(snapshot))
        .layer(middleware::from_fn_with_state(access, check))
        .with_state(shared)
}

#[derive(Deserialize)]
struct Asker {
    token: Option<String>,
    /// It only looks.
    view: Option<String>,
}

async fn check(
    State(access): State<Access>,
    Query(Asker { token, view }): Query<Asker>,
    request: Request,
    next: Next,
) -> Response {
    let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok());
    let role = access.role(token.as_deref(), host);
    let refusal = match role {
        None => "This page takes the address that the console printed, with its token.\n",
        Some(role) if request.method().is_safe() || (role == Role::Pilot && view.is_none()) => {
            return next.run(request).await;
        }
        Some(_) => "This page only looks: nothing was done.\n",
    };
    (StatusCode::FORBIDDEN, refusal).into_response()
}

async fn png(bytes: Arc<[u8]>) -> Response {
    if bytes.is_empty() {
        return StatusCode::NOT_FOUND.into_response();
    }
    let headers = [(header::CONTENT_TYPE, "image/png"), (header::CACHE_CONTROL, "no-store")];
    (headers, Bytes::from_owner(bytes)).into_response()
}

async fn state(State(shared): State<Shared>) -> impl IntoResponse {
    let state = shared.published.borrow().state.clone();
    ([(header::CONTENT_TYPE, "application/json")], Bytes::from_owner(Text(state)))
}

/// A text as bytes, without a copy.
struct Text(Arc<str>);

impl AsRef<[u8]> for Text {
    fn as_ref(&self) -> &[u8] {
        self.0.as_bytes()
    }
}

/// The state, whenever there is a new one.
async fn events(State(shared): State<Shared>) -> Sse<impl Stream<Item = Result<Told, Infallible>>> {
    // Counted for as long as the stream is there.
    let page = shared.published.borrow().pages.subscribe();
    let told = WatchStream::new(shared.published).map(move |published| {
        let _ = &page;
        Ok(Told::default().data(&*published.state))
    });
    Sse::new(told).keep_alive(KeepAlive::default())
}

#[derive(Deserialize)]
struct Wanted {
    /// Left, top, right and bottom as parts of the picture; `null`: none any more.
    parts: Option<[f64; 4]>,
    page: Option<String>,
}

async fn region(State(shared): State<Shared>, Json(wanted): Json<Wanted>) -> Response {
    let region = match wanted.parts.map(|parts| Region::new(parts, WEIGHT)) {
        None => None,
        Some(Some(region)) => Some(region),
        Some(None) => {
            return (StatusCode::BAD_REQUEST, "no rectangle in the picture\n").into_response();
        }
    };
    command(&shared, wanted.page, Command::Region(region))
}

#[derive(Deserialize)]
struct Switch {
    on: bool,
    page: Option<String>,
}

async fn record(State(shared): State<Shared>, Json(Switch { on, page }): Json<Switch>) -> Response {
    command(&shared, page, Command::Record(on))
}

#[derive(Deserialize)]
struct Plain {
    page: Option<String>,
}

/// JSON is asked for so that no page of another site can do it.
async fn snapshot(State(shared): State<Shared>, Json(Plain { page }): Json<Plain>) -> Response {
    command(&shared, page, Command::Snapshot)
}

/// `page`: a name that the page gave itself, to tell its own commands from those of others.
fn command(shared: &Shared, page: Option<String>, command: Command) -> Response {
    // All pages are told.
    let page = page.filter(|page| page.len() <= 32);
    match shared.events.try_send(Event::Command(Asked { page, command })) {
        Ok(()) => StatusCode::ACCEPTED.into_response(),
        Err(TrySendError::Full(_)) => {
            (StatusCode::SERVICE_UNAVAILABLE, "busy; try again\n").into_response()
        }
        Err(TrySendError::Disconnected(_)) => {
            (StatusCode::GONE, "the console has ended\n").into_response()
        }
    }
}
