"""The HTTP interface: pages and programs ask for the same things."""

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Coroutine
from contextlib import asynccontextmanager, suppress
from functools import partial
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route

from scene4d.app._calibrating import Calibrating, known_of
from scene4d.app._guard import Guard, refusal
from scene4d.app._jobs import BusyError, SlowError, Worker
from scene4d.app._openapi import description
from scene4d.app._served import Served
from scene4d.core.errors import InputError, Scene4DError
from scene4d.searching.kept import LONGEST

_SEARCH_S = 60.0
"""A search that takes longer is ended, and answered with an error."""
_WAITING = 4
"""Searches that may wait for the one that runs."""
_LOOK_S, _BEAT_S = 1.0, 15.0
"""How often what is new is looked for, and how often a quiet connection is kept alive."""
_TOLD = (
    *("run", "camera", "number", "version", "growing", "rows", "begin_s", "end_s"),
    "watched",
)
_NUMBERS = {"min_score": (float, int), "min_probability": (float, int), "top": (int,)}
Handler = Callable[[Request], Awaitable[Response]]


_STATUS = {"input": 400, "busy": 429, "slow": 503}


class Api:
    """The handlers of one server; the ``searcher`` searches for all who ask."""

    def __init__(self, served: Served) -> None:
        self._served = served
        self.searcher = Worker()
        self._calibrating = Calibrating()
        self._waiting = 0

    def app(self, token: str | None, names: Collection[str]) -> Starlette:
        """The application, guarded; ``names`` are those that it answers to beside this machine's
        own.
        """
        routes = [
            ("/", "GET", self._page),
            ("/openapi.json", "GET", self._openapi),
            ("/api/scene", "GET", self._scene),
            ("/api/runs/{run:int}/rows", "GET", self._rows),
            ("/api/fused", "GET", self._fused),
            ("/api/runs/{run:int}/video", "GET", self._video),
            ("/api/runs/{run:int}/pieces", "GET", self._pieces),
            ("/api/runs/{run:int}/pieces/{piece:int}", "GET", self._piece),
            ("/api/runs/{run:int}/view", "GET", self._view),
            ("/api/runs/{run:int}/now", "GET", self._now),
            ("/api/search", "POST", self._search),
            ("/api/export", "POST", self._export),
            ("/api/places", "GET", self._places),
            ("/api/places", "PUT", self._save_places),
            ("/api/alerts", "GET", self._alerts),
            ("/api/alerts", "PUT", self._keep_alert),
            ("/api/alerts", "DELETE", self._drop_alert),
            ("/api/runs/{run:int}/calibration", "POST", self._calibrate),
            ("/api/calibration", "GET", self._calibration),
            ("/api/calibration", "DELETE", self._cancel_calibration),
            ("/api/live", "GET", self._live),
        ]
        app = Starlette(
            routes=[Route(path, _told(work), methods=[method]) for path, method, work in routes],
            middleware=[Middleware(partial(Guard, token=token, names=names))],
            lifespan=self._running,
            exception_handlers={404: _absent, 405: _absent},
        )
        app.state.api = self
        return app

    async def _page(self, request: Request) -> Response:
        html = await run_in_threadpool(self._served.page)
        return HTMLResponse(html, headers={"Cache-Control": "no-store"})

    async def _openapi(self, request: Request) -> Response:
        return JSONResponse(description())

    async def _scene(self, request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(self._served.contents))

    async def _rows(self, request: Request) -> Response:
        since = request.query_params.get("since_s")
        try:
            since_s = None if since is None else float(since)
        except ValueError:
            raise InputError("since_s: expected a number of seconds") from None
        if since_s is not None and not abs(since_s) < 1e12:
            raise InputError("since_s: expected a number of seconds")
        return JSONResponse(
            await run_in_threadpool(self._served.rows, request.path_params["run"], since_s)
        )

    async def _fused(self, request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(self._served.fused))

    async def _video(self, request: Request) -> Response:
        path = await run_in_threadpool(self._served.video, request.path_params["run"])
        kind = "video/webm" if path.suffix == ".webm" else "video/mp4"
        return FileResponse(path, media_type=kind)

    async def _now(self, request: Request) -> Response:
        path = await run_in_threadpool(self._served.now, request.path_params["run"])
        return FileResponse(path, media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    async def _pieces(self, request: Request) -> Response:
        run = request.path_params["run"]
        return JSONResponse(await run_in_threadpool(self._served.pieces, run))

    async def _piece(self, request: Request) -> Response:
        where = request.path_params
        made = run_in_threadpool(self._served.piece, where["run"], where["piece"])
        mp4, offset_s = await made
        headers = {"X-Offset-S": f"{offset_s:.6f}", "Cache-Control": "private, max-age=3600"}
        return Response(mp4, media_type="video/mp4", headers=headers)

    async def _view(self, request: Request) -> Response:
        jpeg = await run_in_threadpool(self._served.view, request.path_params["run"])
        return Response(jpeg, media_type="image/jpeg")

    async def _search(self, request: Request) -> Response:
        found = await self._one_search(request, "search", await _body(request))
        return JSONResponse({"searches": found})

    async def _export(self, request: Request) -> Response:
        said = await _body(request)
        form = said.pop("format", None)
        if not isinstance(form, str):
            raise InputError("format: expected text")
        text = await self._one_search(request, "export", said, form=form)
        return PlainTextResponse(text)

    async def _one_search(
        self, request: Request, task: str, said: dict[str, Any], **more: str
    ) -> Any:
        """One at a time: two at once would take as long, and twice the memory."""
        words = _words(said)
        for name, value in said.items():
            if name not in _NUMBERS or type(value) not in _NUMBERS[name]:
                raise InputError(f"{name}: expected words, and numbers: {', '.join(_NUMBERS)}")
        if self._waiting >= _WAITING:
            raise BusyError("other searches are waiting; ask again later")
        self._waiting += 1
        try:
            values = self._served.asked(words, said) | more
            async with asyncio.timeout(_SEARCH_S):
                return await _while_there(request, self.searcher.ask(task, **values))
        except TimeoutError:
            raise SlowError(f"the search takes longer than {_SEARCH_S:.0f} s") from None
        finally:
            self._waiting -= 1

    @asynccontextmanager
    async def _running(self, app: Starlette) -> AsyncIterator[None]:
        yield
        await self.searcher.end()
        await self._calibrating.cancel()

    async def _places(self, request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(self._served.places))

    async def _save_places(self, request: Request) -> Response:
        said = await _body(request)
        await run_in_threadpool(self._served.save_places, said)
        return JSONResponse({"saved": True})

    async def _alerts(self, request: Request) -> Response:
        return JSONResponse({"searches": await run_in_threadpool(self._served.alerts)})

    async def _keep_alert(self, request: Request) -> Response:
        await run_in_threadpool(self._served.keep_alert, _words(await _body(request)))
        return await self._alerts(request)

    async def _drop_alert(self, request: Request) -> Response:
        await run_in_threadpool(self._served.drop_alert, _words(await _body(request)))
        return await self._alerts(request)

    async def _calibrate(self, request: Request) -> Response:
        run, said = request.path_params["run"], known_of(await _body(request))
        values, about = await run_in_threadpool(self._served.to_calibrate, run, said)
        self._calibrating.begin(values, about)
        return JSONResponse(self._calibrating.state, status_code=202)

    async def _calibration(self, request: Request) -> Response:
        return JSONResponse(self._calibrating.state)

    async def _cancel_calibration(self, request: Request) -> Response:
        await self._calibrating.cancel()
        return JSONResponse(self._calibrating.state)

    async def _live(self, request: Request) -> Response:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        return StreamingResponse(
            self._news(request), media_type="text/event-stream", headers=headers
        )

    async def _news(self, request: Request) -> AsyncIterator[str]:
        """Runs, first all and then those that change, and what ``watch`` tells, as server-sent
        events: whoever comes back hears what was missed.
        """
        served = self._served
        known: dict[tuple[str, str], str] = {}
        told, quiet_s = await run_in_threadpool(served.told_so_far), 0.0
        fleet = ""
        yield "retry: 2000\n\n"
        while not (served.ending or await request.is_disconnected()):
            news = []
            with suppress(Scene4DError, OSError):  # a scene that is being replaced: the next time
                news = await run_in_threadpool(_news, served, known, told)
                before, fleet = fleet, json.dumps(await run_in_threadpool(served.fleet))
                news += [("fleet", fleet)] if fleet != before else []
            quiet_s = 0.0 if news else quiet_s + _LOOK_S
            if quiet_s >= _BEAT_S:
                quiet_s = 0.0
                yield ": still here\n\n"
            for kind, line in news:
                yield f"event: {kind}\ndata: {line}\n\n"
            await asyncio.sleep(_LOOK_S)


def _news(
    served: Served, known: dict[tuple[str, str], str], told: dict[str, int]
) -> list[tuple[str, str]]:
    """Runs whose versions are not the ``known`` ones, and lines that were ``told`` since; where no
    run is known, also what was told of each before.
    """
    news = []
    for run in served.refresh() if known else served.contents()["runs"]:
        camera = run["camera"], run["run"]
        if known.get(camera) != run["version"]:
            known[camera] = run["version"]
            news.append(("run", json.dumps({key: run[key] for key in _TOLD if key in run})))
    return news + [("alert", line) for line in served.told(told)]


def _words(said: dict[str, Any]) -> str:
    words = said.pop("words", None)
    if not isinstance(words, str) or not 0 < len(words) <= LONGEST:
        raise InputError(f"words: expected text of 1 to {LONGEST} characters")
    return words


async def _while_there(request: Request, work: Coroutine[Any, Any, Any]) -> Any:
    """What the work gives; it is cancelled where the one who asked has gone."""
    working = asyncio.ensure_future(work)
    leaving = asyncio.ensure_future(_left(request))
    try:
        await asyncio.wait({working, leaving}, return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            raise ClientDisconnect
        return working.result()
    finally:
        leaving.cancel()
        working.cancel()
        await asyncio.wait({working})


async def _left(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


async def _body(request: Request) -> dict[str, Any]:
    """The JSON object that was sent."""
    if request.headers.get("content-type", "").partition(";")[0] != "application/json":
        raise InputError("content-type: expected application/json")
    try:
        said = json.loads(await request.body())
    except (ValueError, RecursionError):
        raise InputError("the request is not JSON") from None
    if not isinstance(said, dict):
        raise InputError("the request is no JSON object")
    return said


def _told(work: Handler) -> Handler:
    """Failures as answers: bad input 400, what is not there 404, too long a body 413."""

    async def answered(request: Request) -> Response:
        try:
            return await work(request)
        except LookupError as error:
            return refusal(404, str(error.args[0]), "absent")
        except ClientDisconnect:
            return refusal(413, "the request is too long")
        except Scene4DError as error:
            status = _STATUS.get(error.kind, 500)
            return refusal(status, " ".join(str(error).split()), error.kind)

    return answered


async def _absent(request: Request, error: Exception) -> Response:
    status = getattr(error, "status_code", 404)
    return refusal(status, f"{request.method} {request.url.path} is not there", "absent")
