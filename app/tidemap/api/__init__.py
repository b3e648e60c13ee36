"""HTTP and WebSocket: schema in, one service call, schema out."""
