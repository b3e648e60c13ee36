"""Tables, repositories, the writer with its group commit, and the codecs of what is stored."""
