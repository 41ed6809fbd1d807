"""Room: what verbs return, findings bound to the pages that lay them out."""
