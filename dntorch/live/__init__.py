"""A structure while it runs: stepped in a session, drawn on a page in the browser."""
