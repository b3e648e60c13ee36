"""Wire forms of API.md, shared by server and client."""
