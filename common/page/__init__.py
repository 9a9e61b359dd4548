"""A page in a browser: what a process shows of itself, live, and the commands that it takes (docs/page.md).

The page is a process of its own beside the learner or the bridge, and reads what the bus carries. This package knows
neither of them:

- `hub`: the channels that a source puts its data into, and what each browser has of them. A channel is a **value**
  (newest wins), a **series** (numbers that are appended) or a **grid** (a belief, of which changed tiles are sent).
- `source`: the `Source` that fills the hub and carries commands out, and the `Site` with its files.
- `app`, `client`, `access`, `protocol`, `tiles`: HTTP and WebSocket, who may do what, and the bytes on the wire.
- `serve`: runs a page in this process; `process` starts it as a child that ends with its parent.
- `options`: the settings, and the options of commands that have them.

A page of one's own is a class and a folder with an ``index.html``::

    class Clock(Source):
        verbs = ("reset",)

        def refresh(self, hub: Hub) -> None:          # so many times a second, in a thread of its own
            hub.put("clock/time", {"seconds": time.monotonic()})
            if hub.watched("clock/picture"):          # what is costly only while somebody looks
                hub.put("clock/picture", paint())

        def carry_out(self, command: Command) -> dict[str, Any]:  # in a thread; an HDError is the refusal
            return {"reset": True}

    serve(PageSettings(port=8080), Site("clock", Path("static")), Clock())

A process that starts its page as a child has a module with ``if __name__ == "__main__": page_main(make)``, where
``make(request)`` builds the site and the source of the mapping that `PageProcess` was given; see `deploy.page.process`.
"""
