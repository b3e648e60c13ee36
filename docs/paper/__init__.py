"""Every figure and table of docs/method.md, from real recordings: `make paper`, or `python -m docs.paper [part ...]`.

A part is a module with `NEEDS`, the recordings it reads (paths in `recordings.FOLDER`), and `make`, which draws its
figures into a folder and returns the blocks of the document it fills, Markdown by name.
"""
