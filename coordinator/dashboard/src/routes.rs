//! Addresses of the server and their answers.

use std::sync::Arc;

use axum::Router;
use axum::extract::{Path, Query, Request, State};
use axum::http::{HeaderValue, StatusCode, Uri, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::sse::{KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use serde::{Deserialize, Serialize};

use crate::access::{self, Access, Token};
use crate::assets;
use crate::live::Hub;
use crate::source::{Drawing, Source, SourceError};

/// Nothing but the server's own files: no inline code, no frame around the page, no form, no
/// connection elsewhere.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
     base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Headers of every answer.
const HEADERS: [(header::HeaderName, &str); 5] = [
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::X_FRAME_OPTIONS, "DENY"),
    // Results of patients do not stay on a disk of the browser.
    (header::CACHE_CONTROL, "no-store"),
];

/// What the answers are made from.
pub struct Shared<S> {
    /// Answers about the run, of which every request asks its own.
    pub source: Arc<S>,
    /// Updates of the run, read once for all browsers.
    pub hub: Arc<Hub>,
    /// The secret of this server.
    pub token: Token,
    /// Style sheet and scripts of the drawings.
    pub drawing: Drawing,
}

/// All addresses. Every one needs the token.
pub fn router<S: Source>(shared: &Arc<Shared<S>>) -> Router {
    let mut router = Router::new();
    for asset in assets::ALL {
        router = router.route(asset.path, get(|| async { file(asset.kind, asset.text) }));
    }
    router
        .route("/report.css", get(report_css::<S>))
        .route("/report.js", get(report_js::<S>))
        .route("/heart.js", get(heart_js::<S>))
        .route("/api/live", get(live::<S>))
        .route("/api/patient/{id}", get(patient::<S>))
        .route("/api/patient/{id}/log", get(log::<S>))
        .route("/api/patient/{id}/heart", get(heart::<S>))
        .route("/api/compare", get(other_runs::<S>))
        .route("/api/compare/{index}", get(compare::<S>))
        .layer(from_fn_with_state(Arc::clone(shared), guard::<S>))
        .with_state(Arc::clone(shared))
}

/// Lets a request through that comes to this machine's name with the token. The first address has
/// the token in it; the answer moves it into a cookie and sends the browser to an address without.
async fn guard<S: Source>(
    State(shared): State<Arc<Shared<S>>>,
    request: Request,
    next: Next,
) -> Response {
    let mut response = if !access::is_local(request.headers()) {
        plain(
            StatusCode::FORBIDDEN,
            "This address is not this machine's: open http://127.0.0.1 or http://localhost with the port.",
        )
    } else if let Some(given) = token_of(request.uri()) {
        if shared.token.is(&given) {
            let to = [
                (header::LOCATION, "/".to_owned()),
                (header::SET_COOKIE, shared.token.set_cookie()),
            ];
            (StatusCode::SEE_OTHER, to).into_response()
        } else {
            plain(StatusCode::FORBIDDEN, OTHER_TOKEN)
        }
    } else {
        match shared.token.access(request.headers()) {
            Access::Granted => next.run(request).await,
            Access::Missing => plain(StatusCode::UNAUTHORIZED, NO_TOKEN),
            Access::Wrong => plain(StatusCode::FORBIDDEN, OTHER_TOKEN),
        }
    };
    for (name, value) in HEADERS {
        response
            .headers_mut()
            .insert(name, HeaderValue::from_static(value));
    }
    response
}

const NO_TOKEN: &str =
    "A token is missing: open the whole address that `cardiotwin dashboard` printed.";
const OTHER_TOKEN: &str = "This token is of another dashboard: open the whole address that `cardiotwin dashboard` printed last.";

/// The token in an address; only the first page's has one.
fn token_of(uri: &Uri) -> Option<String> {
    #[derive(Deserialize)]
    struct First {
        token: Option<String>,
    }
    if uri.path() != "/" {
        return None;
    }
    Query::<First>::try_from_uri(uri).ok()?.0.token
}

fn plain(status: StatusCode, text: &str) -> Response {
    let kind = [(header::CONTENT_TYPE, "text/plain; charset=utf-8")];
    (status, kind, format!("{text}\n")).into_response()
}

fn file(kind: &'static str, text: impl IntoResponse) -> Response {
    ([(header::CONTENT_TYPE, kind)], text).into_response()
}

fn json(text: String) -> Response {
    file("application/json", text)
}

fn as_json(value: &impl Serialize) -> Response {
    match serde_json::to_string(value) {
        Ok(text) => json(text),
        Err(error) => plain(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

impl IntoResponse for SourceError {
    fn into_response(self) -> Response {
        let status = match self {
            Self::Unknown(_) => StatusCode::NOT_FOUND,
            Self::Unreadable(_) => StatusCode::INTERNAL_SERVER_ERROR,
        };
        plain(status, &self.to_string())
    }
}

async fn report_css<S: Source>(State(shared): State<Arc<Shared<S>>>) -> Response {
    file(assets::CSS, shared.drawing.css.clone())
}

async fn report_js<S: Source>(State(shared): State<Arc<Shared<S>>>) -> Response {
    file(assets::JS, shared.drawing.js)
}

async fn heart_js<S: Source>(State(shared): State<Arc<Shared<S>>>) -> Response {
    file(assets::JS, shared.drawing.heart_js)
}

async fn live<S: Source>(State(shared): State<Arc<Shared<S>>>) -> Response {
    Sse::new(shared.hub.stream())
        .keep_alive(KeepAlive::default())
        .into_response()
}

async fn patient<S: Source>(
    State(shared): State<Arc<Shared<S>>>,
    Path(id): Path<String>,
) -> Result<Response, SourceError> {
    Ok(as_json(&shared.source.patient(&id).await?))
}

/// The attempt whose log is wanted.
#[derive(Deserialize)]
struct Wanted {
    attempt: Option<String>,
}

async fn log<S: Source>(
    State(shared): State<Arc<Shared<S>>>,
    Path(id): Path<String>,
    Query(wanted): Query<Wanted>,
) -> Result<Response, SourceError> {
    let log = shared.source.log(&id, wanted.attempt.as_deref()).await?;
    Ok(as_json(&log))
}

async fn heart<S: Source>(
    State(shared): State<Arc<Shared<S>>>,
    Path(id): Path<String>,
) -> Result<Response, SourceError> {
    match shared.source.heart(&id).await? {
        Some(heart) => Ok(as_json(&heart)),
        None => Err(SourceError::Unknown(format!(
            "no simulation of {id} left a surface"
        ))),
    }
}

async fn other_runs<S: Source>(State(shared): State<Arc<Shared<S>>>) -> Response {
    as_json(&shared.source.other_runs())
}

async fn compare<S: Source>(
    State(shared): State<Arc<Shared<S>>>,
    Path(index): Path<usize>,
) -> Result<Response, SourceError> {
    Ok(json(shared.source.compare(index).await?))
}

#[cfg(test)]
mod tests {
    use axum::body::Body;
    use cardiotwin_schemas::heart::HeartSurface;
    use tower::ServiceExt as _;

    use super::*;
    use crate::source::{CohortState, LogText, PatientPage};

    /// A run of one patient without results.
    struct One;

    impl Source for One {
        async fn mark(&self) -> Result<String, SourceError> {
            Ok("1".into())
        }

        async fn state(&self) -> Result<CohortState, SourceError> {
            Ok(CohortState::default())
        }

        async fn patient(&self, patient: &str) -> Result<PatientPage, SourceError> {
            if patient != "a b" {
                return Err(SourceError::Unknown(format!("no patient {patient}")));
            }
            Ok(PatientPage {
                html: "<section></section>".into(),
                attempts: Vec::new(),
                cycle_length_ms: 800.0,
                heart: None,
            })
        }

        async fn log(&self, _: &str, _: Option<&str>) -> Result<LogText, SourceError> {
            Err(SourceError::Unreadable("the disk is gone".into()))
        }

        async fn heart(&self, _: &str) -> Result<Option<HeartSurface>, SourceError> {
            Ok(None)
        }

        fn other_runs(&self) -> Vec<String> {
            Vec::new()
        }

        async fn compare(&self, index: usize) -> Result<String, SourceError> {
            Err(SourceError::Unknown(format!("no run {index}")))
        }

        fn drawing(&self) -> Drawing {
            Drawing {
                css: String::new(),
                js: "",
                heart_js: "",
            }
        }
    }

    fn shared() -> Arc<Shared<One>> {
        Arc::new(Shared {
            source: Arc::new(One),
            hub: Arc::new(Hub::new()),
            token: Token::random().unwrap(),
            drawing: One.drawing(),
        })
    }

    async fn get_with(
        shared: &Arc<Shared<One>>,
        path: &str,
        host: &str,
        cookie: Option<&str>,
    ) -> Response {
        let mut request = axum::http::Request::get(path).header(header::HOST, host);
        if let Some(cookie) = cookie {
            request = request.header(header::COOKIE, cookie);
        }
        let request = request.body(Body::empty()).unwrap();
        router(shared).oneshot(request).await.unwrap()
    }

    #[tokio::test]
    async fn every_answer_has_the_policy_and_none_but_the_first_takes_a_token_in_the_address() {
        let shared = shared();
        let own = shared.token.set_cookie();
        let own = own.split(';').next().unwrap();
        let last = if own.ends_with('0') { '1' } else { '0' };
        let other = format!("{}{last}", &own[..own.len() - 1]);
        let with_token = format!("/?token={}", shared.token.text());
        let cases = [
            ("/", "localhost:1", None, StatusCode::UNAUTHORIZED),
            ("/?token=0", "localhost:1", None, StatusCode::FORBIDDEN),
            (
                with_token.as_str(),
                "evil.example",
                None,
                StatusCode::FORBIDDEN,
            ),
            (
                with_token.as_str(),
                "localhost:1",
                None,
                StatusCode::SEE_OTHER,
            ),
            ("/", "evil.example", Some(own), StatusCode::FORBIDDEN),
            (
                "/",
                "localhost:1",
                Some(other.as_str()),
                StatusCode::FORBIDDEN,
            ),
            ("/", "localhost:1", Some(own), StatusCode::OK),
            (
                "/api/patient/a%20b",
                "localhost:1",
                Some(own),
                StatusCode::OK,
            ),
            (
                "/api/patient/c",
                "localhost:1",
                Some(own),
                StatusCode::NOT_FOUND,
            ),
            (
                "/api/patient/a%20b/log",
                "localhost:1",
                Some(own),
                StatusCode::INTERNAL_SERVER_ERROR,
            ),
            (
                "/api/patient/a%20b/heart",
                "localhost:1",
                Some(own),
                StatusCode::NOT_FOUND,
            ),
            (
                "/api/compare/0",
                "localhost:1",
                Some(own),
                StatusCode::NOT_FOUND,
            ),
            (
                "/../etc/passwd",
                "localhost:1",
                Some(own),
                StatusCode::NOT_FOUND,
            ),
        ];
        for (path, host, cookie, status) in cases {
            let answer = get_with(&shared, path, host, cookie).await;
            assert_eq!(
                answer.status(),
                status,
                "{path} {host} {}",
                cookie.is_some()
            );
            for (name, value) in HEADERS {
                assert_eq!(answer.headers()[&name], value, "{path}");
            }
        }
        let elsewhere = format!("/app.js?token={}", shared.token.text());
        let answer = get_with(&shared, &elsewhere, "localhost:1", None).await;
        assert_eq!(answer.status(), StatusCode::UNAUTHORIZED);
    }
}
